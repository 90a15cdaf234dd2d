"""BED-BPP's packing plans, read: of every order its items in loading order, in one bin."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxpack.io.texts import member, member_index, member_vector, read_json
from jaxpack.model.exact import clean
from jaxpack.model.job import UPRIGHT, Job, PackedBin, Placement, Plan, Sides
from jaxpack.model.numbers import as_size, fault, plain, show

NAMED = 5  # orders in a message
_SIDES = ("length/mm", "width/mm", "height/mm")


def is_packing_plans(path: Path) -> bool:
    """Whether a JSON file has a list for every order, and is no plan as `write_plan_json` has it.

    Raises:
        UserError: it cannot be read or is not JSON.
    """
    data = read_json(path)
    named = isinstance(data, dict) and "job" not in data and "dimension" not in data
    return named and bool(data)


def read_packing_plans(path: Path, jobs: Sequence[Job]) -> list[tuple[Job, Plan]]:
    """The plan of every job, by its name; plans of others are passed over if there is one job.

    Validity is not checked. An item is known by its article (or id), its sides and its weight; what
    is not in the plan is left out, all of it if there is no plan of that name beside others.

    Raises:
        UserError: naming the order and the item, where there is no such order or item or anything
            else is wrong with the file.
    """
    data = read_json(path)
    names = {job.name for job in jobs}
    strange = [name for name in data if name not in names]
    if strange and (len(jobs) > 1 or len(strange) == len(data)):
        known = ", ".join(sorted(names)[:NAMED])
        what = f"is not among the orders of the items, {known}{', ...' * (len(names) > NAMED)}"
        raise fault(f"{path}: order {show(strange[0])}", what, "is it of another file?")
    return [
        (job, _plan(f"{path}: order '{job.name}'", job, data.get(job.name, []))) for job in jobs
    ]


def _plan(where: str, job: Job, actions: Any) -> Plan:
    if not isinstance(actions, list):
        raise fault(where, f"expected a list of items in loading order, found {show(actions)}")
    kinds: dict[tuple[str, Sides], list[int]] = {}
    for index, item in enumerate(job.items):
        kinds.setdefault((item.name, item.size), []).append(index)
    left = [item.copies for item in job.items]
    puts = []
    for number, action in enumerate(actions):
        at = f"{where}, item {number}"
        index = _kind(at, member(action, "item", dict, at), job, kinds, left)
        left[index] -= 1
        way = UPRIGHT[member_index(action, "orientation", len(UPRIGHT), at)]
        puts.append(Placement(index, way, member_vector(action, "flb_coordinates", at)))
    bins = (PackedBin(0, tuple(puts)),) if puts else ()
    return Plan(bins, tuple(index for index, copies in enumerate(left) for _ in range(copies)))


def _kind(
    where: str, item: Any, job: Job, kinds: dict[tuple[str, Sides], list[int]], left: list[int]
) -> int:
    """Which of the job's items it is; of several alike one of which a copy is left."""
    x, y, z = (
        clean(as_size(member(item, key, object, where), f"{where}, key '{key}'")) for key in _SIDES
    )
    name = str(next((item[key] for key in ("article", "id") if item.get(key) is not None), ""))
    alike = kinds.get((name, (x, y, z)), [])
    weight = item.get("weight/kg")
    same = [index for index in alike if job.items[index].weight == weight] or alike
    if not same:
        sides = " x ".join(str(plain(side)) for side in (x, y, z))
        raise fault(where, f"{show(name)} of {sides} is not in the order", "is it of another one?")
    return next((index for index in same if left[index] > 0), same[0])
