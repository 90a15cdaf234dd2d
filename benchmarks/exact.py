"""Packings per second without a grid: many jobs as one batch, beside the surface in NumPy.

Ivancic's 47 jobs, four sorts of each, and the bookshop's 2,144 orders, one of each, at least as
many bins of every type as there are items; `--data FOLDER` names where the files are. Each set is
padded to one shape and packed by one program on one core.
"""

import argparse
import sys
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.timing import report, seconds
from jaxpack.model.encoding import (
    Genes,
    Stock,
    lane_genes,
    load_job,
    most_together,
    padded,
    padded_genes,
)
from jaxpack.model.job import ORIENTATIONS
from jaxpack.packing.top_faces import SHORT, TopFaces
from jaxpack.search.packer import Decoding, pack_jobs
from jaxpack.search.quick import pack_quickly

sys.path.append(str(Path(__file__).parents[1] / "experiments"))
from public_instances import FOLDER, IVANCIC, data_file, read_bookshop, read_ivancic

IN_NUMPY = 100  # packings, by which the surface in NumPy is timed


def turned_alike(stock: Stock, ways: int = len(ORIENTATIONS)) -> Stock:
    """With the last orientation repeated until there are so many."""
    missing = ((0, 0), (0, ways - stock.sizes.shape[1]))
    return stock._replace(
        sizes=np.pad(stock.sizes, (*missing, (0, 0)), "edge"),
        needed=np.pad(stock.needed, missing, "edge"),
    )


def main(repeats: int = 5) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, default=FOLDER)
    folder = parser.parse_known_args()[0].data
    sets = {
        "Ivancic": (read_ivancic(data_file(folder, IVANCIC)), 4),
        "bookshop": (read_bookshop(folder), 1),
    }
    rows = []
    for name, (jobs, lanes) in sets.items():
        loadings = [load_job(job, skip_unfit=True) for job in jobs]
        items, bins, most = (
            1 << (max(map(count, loadings)) - 1).bit_length()
            for count in (
                lambda one: len(one.items),
                lambda one: len(one.bins),
                lambda one: most_together(one.stock),
            )
        )
        stocks = [turned_alike(padded(one.stock, items, bins)) for one in loadings]
        genes = [
            [padded_genes(lane_genes(one, 0, lane), items, bins) for lane in range(lanes)]
            for one in loadings
        ]
        stock = Stock(*map(np.stack, zip(*stocks, strict=True)))
        some = [Genes(*map(np.stack, zip(*of_job, strict=True))) for of_job in genes]
        every = Genes(*map(np.stack, zip(*some, strict=True)))
        short = max(int(one.stock.bins.max()) for one in loadings) <= SHORT
        decoding = Decoding(TopFaces(most, short=short))
        packer, begun = partial(pack_jobs, decoding, stock, every), perf_counter()
        bins, _ = packer()
        first_seconds = perf_counter() - begun
        plain = [(one, lane_genes(one, 0, 0)) for one in loadings[:: -(-len(jobs) // IN_NUMPY)]]

        def in_numpy(plain: list = plain) -> None:
            for one, of_it in plain:
                pack_quickly(one, of_it, blocks=False)

        for (one, of_it), found in zip(plain, bins[:: -(-len(jobs) // IN_NUMPY), 0], strict=True):
            np.testing.assert_array_equal(  # to the bin
                pack_quickly(one, of_it, blocks=False)[0], found[: len(one.items)]
            )
        took = seconds({"jax": packer, "numpy": in_numpy}, repeats)
        ours, theirs = len(jobs) * lanes / took["jax"], len(plain) / took["numpy"]
        rows.append(
            {
                "set": name,
                "packings": len(jobs) * lanes,
                "items padded to": items,
                "pack_jobs, packings/s": ours,
                "NumPy, packings/s": theirs,
                "pack_jobs / NumPy": ours / theirs,
                "first call, s": first_seconds,
            }
        )
    report("exact", rows)
