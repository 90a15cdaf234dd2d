"""The independent check of large plans, beside plans of twice the size and the plain check.

The plain check is the one of the tests, which compares all pairs in Python: on `PLAIN` items, as
it takes hours for those of the table. Seconds are of one core.
"""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.timing import report, seconds
from jaxpack.model.job import Job, Plan
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.rules import Rules

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from large_plans import backwards, column, cubes, fine, heap
from plain_check import plain_check

SHARE = Rules(stability="share")
PLAIN = 216
PLANS: dict[str, tuple[Callable[[int], tuple[Job, Plan]], int]] = {
    "cubes in one bin": (lambda count: cubes(round(count ** (1 / 3))), 13_824),
    "a column": (column, 10_000),
    "small bins": (lambda count: cubes(2, count // 8), 12_000),
    "a row, sides to the 1000th": (fine, 3000),
    "a heap": (heap, 10_000),
    "a column, backwards": (backwards, 10_000),
}


def check(job: Job, plan: Plan) -> list:
    return list(plan_violations(job, plan, SHARE))


def main(repeats: int = 5) -> None:
    rows = []
    for name, (make, count) in PLANS.items():
        small, plan, twice = make(PLAIN), make(count), make(2 * count)
        took = seconds(
            {
                "plain": partial(plain_check, *small, SHARE.support, SHARE.inclusive),
                "small": partial(check, *small),
                "plan": partial(check, *plan),
                "twice": partial(check, *twice),
            },
            repeats,
        )
        rows.append(
            {
                "plan": name,
                "items": plan[0].count,
                "seconds": took["plan"],
                "us an item": took["plan"] / plan[0].count * 1e6,
                "twice the items / seconds": took["twice"] / took["plan"],
                f"plain check / check, {PLAIN} items": took["plain"] / took["small"],
            }
        )
    report("check", rows)
