"""Plans in files as JSON, with all that they say of the job.

Bins, items and their types have the numbers of the job and the plan, from 0; steps count from 1
through all bins. Lengths and weights are in the job's units.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.certificates import alike
from jaxpack.io.steps import Step, sides_of, steps_of
from jaxpack.io.texts import (
    json_line,
    json_lines,
    member,
    member_index,
    member_vector,
    read_json,
    write_text,
)
from jaxpack.model.figures import load_of, profit_of
from jaxpack.model.job import ORIENTATIONS, Job, PackedBin, Placement, Plan, Sides
from jaxpack.model.limits import BinLimits, ItemLimits, Obstacle
from jaxpack.model.numbers import as_number, as_size, fault, plain, show
from jaxpack.model.objectives import named, objective_of
from jaxpack.model.rules import Rules
from jaxpack.model.tariff import Tariff


def write_plan_json(path: Path, job: Job, plan: Plan, rules: Rules = Rules()) -> None:
    """Writes a plan with all that it says of the job, as `plan_json` has it."""
    write_text(path, plan_json(job, plan, rules))


def plan_json(
    job: Job,
    plan: Plan,
    rules: Rules = Rules(),
    about: Mapping[str, object] = MappingProxyType({}),
) -> str:
    """A plan with all that it says of the job, as JSON: a line per bin and per item.

    Positions are front-bottom-left corners, sides and extents along x, y and z; a bin's fill is
    the share of its volume that is filled.
    For the objective height a bin is as high as the plan.

    Args:
        job: what was packed.
        plan: of it.
        rules: by which it was made; those that are not the usual ones are written, as are the
            limits of items and bins.
        about: what else to say of it, before everything else.
    """
    loads: list[list[Step]] = [[] for _ in plan.bins]
    for step in steps_of(job, plan):
        loads[step.bin].append(step)
    bins, profits = [], "PROFIT" in objective_of(job).obeys
    for number, (packed, steps) in enumerate(zip(plan.bins, loads, strict=True)):
        kind = job.bins[packed.bin]
        filled = math.fsum(step.volume for step in steps)
        summary = {
            "bin": number,
            "type": packed.bin,
            "name": kind.name,
            "size": sides_of(kind.size),
            "cost": plain(float(kind.price_of(load_of(job, packed)))),
            "weight": plain(math.fsum(step.item.weight for step in steps)),
            "fill": round(filled / math.prod(kind.size), 6),
            **_said("limits", kind.limits),
            **(_said("tariff", kind.tariff) if kind.tariff else {}),
        }
        items = [_item_row(step, profits) for step in steps]
        if profits:
            summary["profit"] = plain(float(sum(profit_of(step.item) for step in steps)))
        bins.append(
            f'{json_line(summary)[:-1]}, "items": {json_lines(map(json_line, items), "    ")}}}'
        )
    left_out = [json_line({"item": n, "name": job.items[n].name}) for n in plan.left_out]
    head = "".join(f"{json_line(key)}: {json_line(value)},\n" for key, value in about.items())
    head += f'"job": {json_line(job.name)},\n"dimension": {job.dimension}'
    if job.objective:
        head += f',\n"objective": {json_line(job.objective)}'
    if own := _said("rules", replace(rules, rule=Rules.rule)):
        head += f',\n"rules": {json_line(own["rules"])}'
    lists = f'"bins": {json_lines(bins, "  ")},\n"left_out": {json_lines(left_out, "  ")}'
    return f"{{\n{head},\n{lists}\n}}\n"


def _item_row(step: Step, profits: bool) -> dict[str, Any]:
    return {
        "step": step.number,
        "item": step.placement.item,
        "name": step.item.name,
        "position": sides_of(step.placement.corner),
        "extent": sides_of(step.extent),
        "orientation": step.placement.orientation,
        "weight": plain(step.item.weight),
        **({"profit": plain(float(profit_of(step.item)))} if profits else {}),
        **_said("limits", step.item.limits),
    }


def _said(name: str, what: Rules | ItemLimits | BinLimits | Tariff) -> dict[str, Any]:
    """What in it is not as it is by default, under that name; nothing if all is."""
    if what == type(what)():
        return {}
    usual = asdict(type(what)())
    return {name: {key: value for key, value in asdict(what).items() if value != usual[key]}}


def plan_rules(path: Path) -> dict[str, Any]:
    """Those of `Rules` by which a plan that `write_plan_json` wrote says that it was made.

    Raises:
        UserError: where it cannot be read, or there is no such rule.
    """
    data = read_json(path)
    if not isinstance(data, dict) or "rules" not in data or "job" not in data:
        return {}
    where, rules = f"{path}: key 'rules'", member(data, "rules", dict, str(path))
    known = {field.name for field in fields(Rules)} - {"rule"}
    if unknown := [name for name in rules if name not in known]:
        raise fault(where, f"{show(unknown[0])} is not known: there are {', '.join(sorted(known))}")
    Rules(**rules).checked(lambda name: f"{where}, {name}")
    return dict(rules)


def plan_objective(path: Path) -> str:
    """What a plan that `write_plan_json` wrote says that it is for; "" if nothing.

    Raises:
        UserError: where it cannot be read, or there is no such objective.
    """
    data = read_json(path)
    if not isinstance(data, dict) or "objective" not in data or "job" not in data:
        return ""
    name: str = member(data, "objective", str, str(path))
    try:
        named(name)
    except UserError as error:
        raise fault(path, "key 'objective'", error) from None
    return name


def with_plan_obstacles(path: Path, job: Job) -> Job:
    """The job, with the obstacles that a plan that `write_plan_json` wrote says its bins have.

    Raises:
        UserError: where they cannot be read, are none, or are not the same in all bins of a type.
    """
    taken: dict[int, tuple[Obstacle, ...]] = {}
    for number, one in enumerate(member(read_json(path), "bins", list, str(path))):
        where = f"{path}: bin {number}"
        kind = member_index(one, "type", len(job.bins), where)
        limits = member(one, "limits", dict, where) if "limits" in one else {}
        boxes = member(limits, "obstacles", list, where) if "obstacles" in limits else []
        some = tuple(
            Obstacle(*(member_vector(box, key, at) for key in ("corner", "size"))).checked(
                at, job.bins[kind].size, job.dimension
            )
            for at, box in ((f"{where}, obstacle {n}", box) for n, box in enumerate(boxes))
        )
        if taken.setdefault(kind, some) != some:
            raise fault(where, "other obstacles than in a bin of the same type: give --obstacles")
    bins = (
        replace(kind, limits=replace(kind.limits, obstacles=taken.get(number, ())))
        for number, kind in enumerate(job.bins)
    )
    return replace(job, bins=tuple(bins))


def read_plan_json(path: Path, job: Job) -> Plan:
    """The plan that `write_plan_json` wrote of a job; its validity is not checked.

    Raises:
        UserError: naming the bin and the item, where its types are not those of the job or
            anything else is wrong with the file.
    """
    data = read_json(path)
    bins = []
    for number, one in enumerate(member(data, "bins", list, str(path))):
        where = f"{path}: bin {number}"
        bin_type = member_index(one, "type", len(job.bins), where)
        x, y, z = job.bins[bin_type].size
        height = None
        if objective_of(job).open_bin:
            z = height = as_size(member_vector(one, "size", where)[2], f"{where}, key 'size'")
        _check_vector(one, "size", (x, y, z), where)
        items = enumerate(member(one, "items", list, where))
        placed = tuple(_placement(item, job, f"{where}, item {index}") for index, item in items)
        bins.append(PackedBin(bin_type, placed, height))
    left = enumerate(member(data, "left_out", list, str(path)))
    left_out = (
        member_index(one, "item", len(job.items), f"{path}: left_out {n}") for n, one in left
    )
    return Plan(tuple(bins), tuple(left_out))


def _placement(data: Any, job: Job, where: str) -> Placement:
    index = member_index(data, "item", len(job.items), where)
    orientation = member(data, "orientation", str, where)
    if orientation not in ORIENTATIONS:
        what = f"{show(orientation)} is not known: use {', '.join(ORIENTATIONS)}"
        raise fault(where, "key 'orientation'", what)
    _check_vector(data, "extent", job.items[index].turned(orientation), where)
    if "profit" in data:
        profit = float(profit_of(job.items[index]))
        if not alike(found := as_number(data["profit"], f"{where}, key 'profit'"), profit):
            what = f"{plain(found)}, but this job has {plain(profit)}: is it of another job?"
            raise fault(where, "key 'profit'", what)
    return Placement(index, orientation, member_vector(data, "position", where))


def _check_vector(data: Any, key: str, wanted: Sides, where: str) -> None:
    found = member_vector(data, key, where)
    if not all(map(alike, found, wanted)):
        what = f"{sides_of(found)}, but this job has {sides_of(wanted)}: is it of another job?"
        raise fault(where, f"key '{key}'", what)
