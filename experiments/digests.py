"""Are placements what they were, to the cell? Digests of packings, compared with those kept.

python experiments/digests.py [--data FOLDER] [--write]     (15 minutes on one core)

Every method on the paper's presets, 1,000 instances with seed 0 and small counts (BRKGA 20 x 5,
searches of two). Without a grid twelve sorts in NumPy, and 32 as one compiled batch, of Ivancic's
47 jobs and of 30 of the two-dimensional instances. `--write` keeps what comes out, for the next
change of the kernels, in results/digests.json. Methods that learn compute in floats: there another
processor may decide otherwise between equals.
"""

import argparse
import hashlib
import json
from pathlib import Path

import jax
import numpy as np
from public_instances import (
    BERKEY_WANG,
    IVANCIC,
    add_data_option,
    data_file,
    read_2bp,
    read_ivancic,
)
from rows import RESULTS

from jaxpack import Cell, Comparison, MethodOptions, make_method, preset
from jaxpack.cli import prepare_jax
from jaxpack.comparison import make_instances
from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import Job
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.compiled import LANES, first_genes
from jaxpack.search.packer import encode, pack_lanes
from jaxpack.search.protocol import pack_orders
from jaxpack.search.quick import pack_quickly

METHODS = (
    "random", "volume", "footprint", "height", "best-of-20", "brkga", "pointer", "bin-aware",
    "bin-aware-best-of-4", "bin-aware-beam-2", "bin-aware-search", "brkga-seeded",
)  # fmt: skip
BATCH, INSTANCES, SORTS = 100, 1000, 12
KEPT = RESULTS / "digests.json"


def digest(*arrays: object) -> str:
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(np.asarray(array)).astype(np.int64).tobytes())
    return found.hexdigest()[:16]


def together(parts: list[str]) -> str:
    return hashlib.sha256("".join(parts).encode()).hexdigest()[:16]


def of_method(preset_name: str, method: str) -> str:
    recipe = preset(preset_name)
    problem, distribution = recipe.problem, recipe.distribution
    comparison = Comparison(problem, INSTANCES, batch=BATCH)
    instances, keys = make_instances(
        comparison, Cell(problem.bin, distribution), distribution.items
    )
    options = MethodOptions(
        brkga=BrkgaConfig(20, 5), width=2, draws=2, rounds=2, breeding=2, kinds=recipe.kinds
    )
    orders_of = make_method(method, problem, options).orders

    @jax.jit
    def packed(keys, instances):
        orders = orders_of(keys, instances)
        packing = pack_orders(problem, instances, orders)
        return orders, packing.bin, packing.position, packing.volume, packing.top, packing.shadow

    parts = []
    for first in range(0, INSTANCES, BATCH):
        rows = slice(first, first + BATCH)
        parts.append(digest(*packed(*jax.tree.map(lambda leaf: leaf[rows], (keys, instances)))))  # noqa: B023
    return together(parts)


def public_jobs(data: Path) -> list[Job]:
    flat = read_2bp(data_file(data, BERKEY_WANG))
    some = [job for job, known in flat if known["id"] == 1 and known["n"] in (20, 60, 100)]
    return read_ivancic(data_file(data, IVANCIC)) + some


def in_numpy(jobs: list[Job]) -> str:
    loadings = [load_job(job) for job in jobs]
    return together(
        [
            digest(*pack_quickly(one, lane_genes(one, 0, lane)))
            for one in loadings
            for lane in range(SORTS)
        ]
    )


def in_one_batch(jobs: list[Job]) -> str:
    parts = []
    for job in jobs:
        loading = load_job(job)
        decoding, stock = encode(loading)
        bins, _ = pack_lanes(decoding, stock, first_genes(loading, stock, 0, LANES))
        parts.append(digest(bins[:, : len(loading.items)]))
    return together(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep what comes out")
    add_data_option(parser)
    options = parser.parse_args()
    prepare_jax()
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    found: dict[str, str] = {}

    def tell(name: str, of_it: str) -> None:
        found[name] = of_it
        same = "same" if kept.get(name) == of_it else "DIFFERENT" if name in kept else "new"
        print(f"{name:<36}{of_it}  {same}", flush=True)

    jobs = public_jobs(options.data)
    tell("numpy", in_numpy(jobs))
    tell("exact sorts", in_one_batch(jobs))
    for name in ("paper-2d", "paper-3d"):
        for method in METHODS:
            tell(f"{name} {method}", of_method(name, method))
    if options.write:
        KEPT.write_text(json.dumps(found, indent=2) + "\n")
    elif any(kept.get(name) != of_it for name, of_it in found.items()):
        raise SystemExit("error: placements are not what they were")


if __name__ == "__main__":
    main()
