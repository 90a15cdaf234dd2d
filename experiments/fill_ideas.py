"""What every idea of filling bins by value gives: each one off, at equal time.

python experiments/fill_ideas.py [--seconds 1] [--only TEXT]     (an hour and a half on one core)

Nothing but the passes, on one core, without the compiled search: Ivancic's 47, 35 containers of
Bischoff and Ratcliff of which the greatest volume is wanted, both with more than half of a base
supported and with all of it, and every sixth mail order. Seconds are CPU seconds of the process,
for a container three times as many; with 0 it is one pass. Writes results/fill-ideas.csv, a row per
idea as soon as it is done; rows that are there are kept.
"""

import argparse
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
from public_instances import (
    BISCHOFF_RATCLIFF,
    IVANCIC,
    add_data_option,
    data_file,
    read_bischoff_ratcliff,
    read_bookshop,
    read_ivancic,
)
from rows import RESULTS, read_rows, write_rows

from jaxpack.model.encoding import Loading, load_job
from jaxpack.model.job import Job
from jaxpack.model.rules import Rules
from jaxpack.search import bin_values, draws
from jaxpack.search.block_policy import shipped
from jaxpack.search.local_search import Best

IDEAS: dict[str, list[tuple[ModuleType, str, Any]]] = {
    "all of them": [],
    "the hand-made score, no policy": [],
    "values are not corrected": [(bin_values, "PASSES", 1)],
    "one filling of a bin, in two directions": [
        (bin_values, "DRAWS", 2),
        (bin_values, "FEWEST", 2),
    ],
    "no noise on the values of a draw": [(draws, "DRAWN", 0.0)],
    "none between the orientations of a kind": [(draws, "TURNED", 0.0)],
    "blocks as large as can be": [(draws, "LESS", 0.0)],
    "no cover of the pool": [(bin_values, "COVER", 10**9)],
    "no beam": [(bin_values, "BEAMS", ((128, 1, 1),))],
    "beams of half the width": [(bin_values, "BEAMS", ((16, 2, 4), (32, 1, 3)))],
}
BY_HAND = "the hand-made score, no policy"


def best_of_all(loading: Loading, seconds: float, by_hand: bool) -> Best:
    """The best packing of so much time."""
    end, best = time.process_time() + seconds, None

    def late() -> bool:
        return best is not None and time.process_time() > end

    judge = None if by_hand else shipped()
    alone = not loading.objective.leaves_out
    for found, _ in bin_values.search_values(loading, 0, late, judge=judge):
        if found and (best is None or found.cost < best.cost):
            best = found
        if late() or (alone and len(np.unique(best.bin)) == 1):
            break
    assert best
    return best


def bins_of(loading: Loading, best: Best) -> float:
    """Number of bins."""
    return len(np.unique(best.bin[best.bin >= 0]))


def share_of(loading: Loading, best: Best) -> float:
    """Share of the container that is filled."""
    volume = loading.stock.sizes[:, 0].astype(float).prod(1)
    return float(volume[best.bin >= 0].sum() / loading.stock.bins[0].astype(float).prod())


def result(
    jobs: list[Job], support: float, seconds: float, idea: str, measure: Callable
) -> list[float]:
    """Of every job, with an idea off."""
    with ExitStack() as off:
        for module, name, value in IDEAS[idea]:
            off.enter_context(patch.object(module, name, value))
        loadings = [load_job(job, Rules(support)) for job in jobs]
        return [measure(one, best_of_all(one, seconds, idea == BY_HAND)) for one in loadings]


def sets(data: Path) -> dict[str, tuple[list[Job], float, float, Callable]]:
    """By column: jobs, support, seconds beside those that are given, and what is measured."""
    ivancic = read_ivancic(data_file(data, IVANCIC))
    br = read_bischoff_ratcliff(data_file(data, BISCHOFF_RATCLIFF))
    return {
        "ivancic_0.5": (ivancic, 0.5, 1.0, bins_of),
        "ivancic_1": (ivancic, 1.0, 1.0, bins_of),
        "br_0.5": (br, 0.5, 3.0, share_of),
        "br_1": (br, 1.0, 3.0, share_of),
        "bookshop_0.5": (read_bookshop(data)[::6], 0.5, 0.3, bins_of),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--only", default="", help="ideas with this in their names")
    options = parser.parse_args()
    columns = sets(options.data)
    path = RESULTS / "fill-ideas.csv"
    rows = read_rows(path)
    done = {(row["off"], float(row["seconds"])) for row in rows}
    for idea in IDEAS:
        if (idea, options.seconds) in done or options.only not in idea:
            continue
        row: dict[str, Any] = {"off": idea, "seconds": options.seconds}
        for name, (jobs, support, times, measure) in columns.items():
            if "beam" in idea and measure is bins_of:  # there is none where bins are many
                row[name] = ""
                continue
            found = result(jobs, support, times * options.seconds, idea, measure)
            share = measure is share_of
            row[name] = round(sum(found) / len(found), 4) if share else int(sum(found))
            print(row, flush=True)
        rows.append(row)
        write_rows(path, rows)


if __name__ == "__main__":
    main()
