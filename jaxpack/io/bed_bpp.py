"""BED-BPP: its orders as jobs, and plans as its evaluator reads them.

Lengths are in mm, weights in kg. What is on a target higher than 2 m counts as not packed.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.notes import Say, note, silent
from jaxpack.io.steps import Step, sides_of, steps_of
from jaxpack.io.texts import member, read_json, write_text
from jaxpack.model.job import MOST_ITEMS, UPRIGHT, BinType, ItemType, Job, Plan
from jaxpack.model.numbers import as_size, as_weight, fault, plain, show

TARGETS = {"euro-pallet": (1200.0, 800.0, 2000.0), "rollcontainer": (800.0, 700.0, 2000.0)}
"""What an order is loaded on, and up to which height, mm."""

_SIDES = ("length/mm", "width/mm", "height/mm")
_LABELS = ("article", "id", "product_group", "sequence")


def read_orders(
    path: Path,
    bins: tuple[BinType, ...] | None = None,
    copies: int | None = None,
    bad: Callable[[str, UserError], object] | None = None,
) -> list[Job]:
    """A job per order: equal items are copies of one; upright, any side ahead.

    What an item is beside its sides and weight is kept, for each copy, in `ItemType.tags`.

    Args:
        path: a .json file.
        bins: instead of the targets that the orders name.
        copies: how many targets each order may have; any number if not given.
        bad: takes the name of an order that cannot be read, and why; it is raised if not given.

    Raises:
        UserError: naming the order, the item and the key.
    """
    orders = read_json(path)
    if not isinstance(orders, dict) or not orders:
        raise fault(path, "expected an object of orders by name, as BED-BPP has them")
    jobs = []
    for name in orders:
        try:
            jobs.append(_order(f"{path}: order '{name}'", name, orders[name], bins, copies))
        except UserError as error:
            if bad is None:
                raise
            bad(name, error)
    return jobs


def _order(
    where: str, name: str, order: Any, bins: tuple[BinType, ...] | None, targets: int | None
) -> Job:
    sequence = member(order, "item_sequence", dict, where)
    if not sequence:
        raise fault(where, "key 'item_sequence' has no items: give at least one")
    if len(sequence) > MOST_ITEMS:
        raise fault(where, f"more than {MOST_ITEMS:,} items: split it")
    tags: dict[ItemType, list[dict[str, Any]]] = {}
    for number, (key, item) in enumerate(sequence.items(), 1):
        kind = _item(f"{where}, item '{key}'", item)
        labels = {label: item[label] for label in _LABELS if label in item}
        tags.setdefault(kind, []).append({"sequence": number} | labels)
    items = tuple(
        replace(kind, copies=len(copies), tags=tuple(copies)) for kind, copies in tags.items()
    )
    return Job(items, bins or (_target(where, order, targets),), name=name)


def _item(where: str, item: Any) -> ItemType:
    x, y, z = (as_size(member(item, key, object, where), f"{where}, key '{key}'") for key in _SIDES)
    key = "weight/kg"
    weight = as_weight(member(item, key, object, where), f"{where}, key '{key}'")
    for key in _LABELS:
        if not isinstance(item.get(key, ""), str | int | float | None):
            raise fault(where, f"{key} {show(item[key])}", "expected a text")
    label = next((item[key] for key in ("article", "id") if item.get(key) is not None), "")
    return ItemType((x, y, z), weight=weight, orientations=UPRIGHT, name=str(label))


def _target(where: str, order: Any, copies: int | None) -> BinType:
    properties = order.get("properties", {})
    if not isinstance(properties, dict):
        raise fault(where, "key 'properties'", "expected an object")
    target = properties.get("target", "euro-pallet")
    if not isinstance(target, str) or target not in TARGETS:
        what = f"{show(target)} is not known: use {' or '.join(TARGETS)}, or give a file of bins"
        raise fault(where, "key 'target'", what)
    return BinType(TARGETS[target], copies=copies, name=target)


def write_bed_bpp(
    path: Path, jobs: Sequence[Job], plans: Sequence[Plan], say: Say = silent
) -> None:
    """Writes BED-BPP's packing plans: per order, by the jobs' names, its items in loading order.

    The format knows one target per order: of a plan with more bins the one with the most items is
    written, and how many items are left off is said. Orientations are 0 (as given) and 1 (turned
    on the floor). Items have what their order says of them; those of other jobs their name as
    article, its end after a hyphen as id, and the step as sequence.

    Args:
        path: the file.
        jobs: the orders.
        plans: one for each.
        say: takes a line for each order that is not written whole, or not exactly.

    Raises:
        UserError: where a plan has other orientations, or two jobs one name.
    """
    orders: dict[str, list[dict[str, object]]] = {}
    for job, plan in zip(jobs, plans, strict=True):
        where = f"{path}: order '{job.name}'"
        if job.name in orders:
            raise fault(where, "is there twice: give jobs names of their own")
        labels = [iter(item.tags) for item in job.items]
        orders[job.name] = [
            _action(number, step, next(labels[step.placement.item], {}), where)
            for number, step in enumerate(_fullest(job, plan), 1)
        ]
        if missing := job.count - len(orders[job.name]):
            say(note(where, f"{missing:,} of {job.count:,} items are left off its one target"))
        places = [side for action in orders[job.name] for side in action["flb_coordinates"]]  # type: ignore[attr-defined]
        if any(isinstance(side, float) for side in places):
            say(note(where, "BED-BPP's evaluator cuts off the decimals of its positions"))
    write_text(path, json.dumps(orders, indent=1, ensure_ascii=False) + "\n")


def _fullest(job: Job, plan: Plan) -> list[Step]:
    """The steps of the bin with the most items; of several the one with the most volume."""
    loads: list[list[Step]] = [[] for _ in plan.bins]
    for step in steps_of(job, plan):
        loads[step.bin].append(step)
    return max(loads, key=lambda load: (len(load), sum(s.volume for s in load)), default=[])


def _action(number: int, step: Step, labels: Any, where: str) -> dict[str, object]:
    placement, item = step.placement, step.item
    if placement.orientation not in UPRIGHT:
        what = f"item {placement.item} lies {placement.orientation}, BED-BPP has XYZ and YXZ only"
        raise fault(where, what, "write JSON or a certificate")
    known = {
        "article": item.name,
        "id": item.name.rpartition("-")[2],
        "product_group": "",
        **dict(zip(_SIDES, sides_of(item.size), strict=True)),
        "weight/kg": plain(item.weight),
        "sequence": number,
    }
    return {
        "item": known | labels,
        "flb_coordinates": sides_of(placement.corner),
        "orientation": UPRIGHT.index(placement.orientation),
    }
