"""The items of a plan and the obstacles of its bins as boxes in whole numbers, exactly."""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from jaxpack.model.box_check import Boxes
from jaxpack.model.exact import DIGITS, exact
from jaxpack.model.job import Job, Plan, Sides
from jaxpack.model.rules import Rules
from jaxpack.model.units import common

NOISE = 1e-12  # of the longest side of a bin: a position that misses a unit by less is on it


class Laid(NamedTuple):
    """Rows are in loading order within each bin, after its obstacles."""

    boxes: Boxes
    carrying: Boxes  # the same, with as much on top of each item as has to be free of others
    item: np.ndarray  # int [n], index in Job.items; -1 of an obstacle
    turn: np.ndarray  # int [n], items that the bin held before; -1 of its first obstacle, -2, ...
    units: list[Fraction]  # the length of one along every axis
    spacing: list[int]  # the gap along every axis, in these units
    reach: list[int]  # the overhang, likewise


def laid_out(job: Job, plan: Plan, rules: Rules) -> Laid:
    """The boxes of a plan whose entries all name something; it has at least one item."""
    corner, extent, item, turn = list[Sides](), list[Sides](), list[int](), list[int]()
    loads = []
    for packed in plan.bins:
        puts, obstacles = packed.placements, job.bins[packed.bin].limits.obstacles
        corner += [one.corner for one in obstacles]
        corner += [put.corner for put in puts]
        extent += [one.size for one in obstacles]
        extent += [job.items[put.item].turned(put.orientation) for put in puts]
        item += [-1] * len(obstacles)
        item += [put.item for put in puts]
        turn += range(-1, -1 - len(obstacles), -1)
        turn += range(len(puts))
        loads.append(len(obstacles) + len(puts))
    number = np.repeat(np.arange(len(loads)), loads)
    room = np.array([job.room(packed) for packed in plan.bins])[number]
    longest = room[:, list(job.axes)].max(axis=1)
    unit = common([job.unit, *rules.lengths])
    # The width of what is flat is 1, whatever the unit of the others.
    units = [unit if axis in job.axes else Fraction(1) for axis in range(3)]
    low, size, far = _whole(np.array([corner, extent, room], float), units, longest)
    lengths = rules.spacing(job.dimension), rules.reach(job.dimension)
    spacing, reach = (
        [int(exact(length) / one) for length, one in zip(three, units, strict=True)]
        for three in lengths
    )
    boxes, items = Boxes(number, low, low + size, far), np.array(item)
    carrying = boxes
    if above := spacing[2]:
        top = boxes.high + np.array([0, 0, above]) * (items >= 0)[:, None]
        carrying = boxes._replace(high=top, room=boxes.room + np.array([0, 0, above]))
    return Laid(boxes, carrying, items, np.array(turn), units, spacing, reach)


def _whole(lengths: np.ndarray, units: list[Fraction], longest: np.ndarray) -> np.ndarray:
    """Whole numbers: int64, or Python's numbers where these are too large.

    Args:
        lengths: finite [k, n, axes].
        units: of every axis what most of them are multiples of; replaced where one has to be finer.
        longest: [n], the longest side of the bin.
    """
    steps, sides = np.array([float(unit) for unit in units]), longest[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        count = np.rint(lengths / steps)
        near = (abs(lengths - count * steps) < NOISE * sides) & (abs(count) < 2**50)
    whole = np.where(near, count, 0).astype(np.int64)
    for axis in np.flatnonzero(~near.all((0, 1))).tolist():
        off, unit = ~near[..., axis], units[axis]
        sides = np.broadcast_to(longest, off.shape)[off].tolist()
        between = list(zip(lengths[off, axis].tolist(), sides, strict=True))
        known = {(length, side): _meant(length, unit, side) / unit for length, side in set(between)}
        finer = math.lcm(*(ratio.denominator for ratio in known.values()))
        exactly = whole[..., axis].astype(object) * finer
        exactly[off] = [int(known[key] * finer) for key in between]
        if abs(exactly).max() >= 2**61:
            whole = whole.astype(object)
        whole[..., axis], units[axis] = exactly, unit / finer
    return whole


def _meant(length: float, unit: Fraction, side: float) -> Fraction:
    """The multiple of the unit that is near, or the decimal up to the side's 13th digit."""
    exactly = Fraction(length)
    multiple = round(exactly / unit) * unit
    if abs(exactly - multiple) < Fraction(side) * Fraction(NOISE):
        return multiple
    exponent = int(f"{side:.12e}".split("e")[1])
    grain = Fraction(10) ** (exponent + 1 - DIGITS)
    return round(exactly / grain) * grain
