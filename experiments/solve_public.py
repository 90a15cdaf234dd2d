"""Public instances through the solver, each with so many seconds.

python experiments/solve_public.py 2bp|mpv|ivancic|br|bed|bookshop [--support 0.5] [--inclusive]
    [--seconds 10] [--only TEXT] [--data FOLDER]

Adds a row per instance to results/solve-SET-support-S.csv, with other seconds than ten in its name;
instances that have one are left out, so that it goes on where it was stopped. Every plan has passed
the check. Prints the sum of the bins, or of `br` the mean share of the container that is filled.
"""

import argparse
import math
import time
from pathlib import Path

from public_instances import (
    BED_BPP,
    BERKEY_WANG,
    BISCHOFF_RATCLIFF,
    IVANCIC,
    add_data_option,
    data_file,
    read_2bp,
    read_bischoff_ratcliff,
    read_bookshop,
    read_ivancic,
)
from rows import RESULTS, read_rows, write_rows

from jaxpack.io.jobs import read_job
from jaxpack.model.classes import mpv
from jaxpack.model.job import Job
from jaxpack.model.rules import STABILITIES, Rules
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import End

MPV_CLASSES, MPV_SIZES = (1, 4, 5, 6, 7, 8), (50, 100, 150, 200)


def instances(name: str, data: Path) -> list[tuple[dict, Job]]:
    """What a row says of the instance, and the instance."""
    if name == "2bp":
        return [
            ({"cls": known["cls"], "n": known["n"], "best_known": known["bks"]}, job)
            for job, known in read_2bp(data_file(data, BERKEY_WANG))
        ]
    if name == "ivancic":
        return [({}, job) for job in read_ivancic(data_file(data, IVANCIC))]
    if name == "br":
        return [({}, job) for job in read_bischoff_ratcliff(data_file(data, BISCHOFF_RATCLIFF))]
    if name == "bed":
        return [({}, job) for job in read_job(data_file(data, BED_BPP))]
    if name == "bookshop":
        return [({}, job) for job in read_bookshop(data)]
    return [
        ({"cls": cls, "n": n}, mpv(cls, n, number))
        for cls in MPV_CLASSES
        for n in MPV_SIZES
        for number in range(1, 11)
    ]


def compiled(row: dict) -> bool:
    """Whether a search had no time to search."""
    return row["end"] == End.UNREADY.name


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", choices=("2bp", "mpv", "ivancic", "br", "bed", "bookshop"))
    add_data_option(parser)
    parser.add_argument("--support", type=float, default=0.5)
    parser.add_argument("--inclusive", action="store_true", help="exactly that share is enough")
    parser.add_argument("--stability", default=Rules.stability, choices=STABILITIES)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-policy", dest="policy", action="store_false")
    parser.add_argument("--only", default="", help="instances whose name has this in it")
    options = parser.parse_args()
    how = f"-{options.seconds:g}s" * (options.seconds != 10)
    how += "-inclusive" * options.inclusive + "-no-policy" * (not options.policy)
    how += f"-{options.stability}" * (options.stability != "share")
    path = RESULTS / f"solve-{options.set}-support-{options.support:g}{how}.csv"
    # Where the time went into compiling, the instance is done again.
    rows: list[dict] = [row for row in read_rows(path) if not compiled(row)]
    done = {row["instance"] for row in rows}
    for about, job in instances(options.set, options.data):
        if job.name in done or options.only not in job.name:
            continue
        settings = SolveOptions(
            options.seconds,
            options.seed,
            Rules(options.support, options.inclusive, stability=options.stability),
            policy=options.policy,
        )
        began = time.perf_counter()
        found = solve_job(job, settings)
        row = {"instance": job.name, **about, "bins": found.bins, "lower_bound": found.bounds.bins}
        row |= {"seconds": round(time.perf_counter() - began, 2), "packings": found.packings}
        if options.set == "br":
            row["filled"] = round(found.measure / math.prod(job.bins[0].size), 4)
        rows.append(row | {"end": found.end.name, "limit": options.seconds})
        print(rows[-1], flush=True)
        write_rows(path, rows)
    if options.set == "br":
        mean = sum(float(row["filled"]) for row in rows) / len(rows)
        print(f"{len(rows)} containers, {100 * mean:.2f} % filled")
    else:
        print(f"{len(rows)} instances, {sum(int(row['bins']) for row in rows)} bins")


if __name__ == "__main__":
    main()
