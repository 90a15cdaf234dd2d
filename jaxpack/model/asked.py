"""What a job asks of single items and bins, and its gaps and edges, as arrays for packers."""

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from jaxpack.model.exact import exact
from jaxpack.model.job import Job
from jaxpack.model.limits import Obstacle
from jaxpack.model.rules import Rules

LAST = 2**31
"""The stop of what has none: after all others."""
ANY = 2**31
"""A number that is no limit."""


@dataclass(frozen=True)
class Asked:
    """By item type [I] or bin type [T], lengths in units of a packer."""

    weight: np.ndarray  # float64 [I], in the job's unit
    mass: np.ndarray  # float64 [I], for centres of mass: the volume where nothing weighs anything
    above: np.ndarray  # float64 [I], weight that may rest on one
    stackable: np.ndarray  # bool [I]
    most_in_stack: np.ndarray  # int64 [I]
    stack_id: np.ndarray  # int64 [I]
    group: np.ndarray  # int64 [I], -1 for none
    apart: np.ndarray  # int64 [I], -1 for none
    stop: np.ndarray  # int64 [I]
    floor: np.ndarray  # bool [I]
    most_items: np.ndarray  # int64 [T]
    obstacles: tuple[np.ndarray, ...]  # of every bin type int64 [O, 2, 3]: low and high corners
    gap: int
    overhang: int
    layer: np.ndarray  # int [I], the less, the lower it is better off, by all of these


def asked_of(job: Job, rules: Rules, unit: Fraction) -> Asked:
    """All of it: gaps and obstacles at least as large as given, where they are no whole units."""
    limits = [item.limits for item in job.items]
    carriers = [
        (not one.floor, not one.stackable, -one.weight_above, -item.weight * rules.heavy_below)
        for one, item in zip(limits, job.items, strict=True)
    ]
    weight = np.array([item.weight for item in job.items], float)
    volume = np.array([math.prod(item.size) for item in job.items])
    return Asked(
        weight=weight,
        mass=weight if weight.any() else volume,
        above=np.array([one.weight_above for one in limits], float),
        stackable=np.array([one.stackable for one in limits], bool),
        most_in_stack=np.array([_or(one.most_in_stack, ANY) for one in limits], np.int64),
        stack_id=np.array([one.stack_id for one in limits], np.int64),
        group=_codes(one.group for one in limits),
        apart=_codes(one.apart for one in limits),
        stop=np.array([_or(one.stop, LAST) for one in limits], np.int64),
        floor=np.array([one.floor for one in limits], bool),
        most_items=np.array([_or(kind.limits.most_items, ANY) for kind in job.bins], np.int64),
        obstacles=tuple(
            np.array([_ends(one, job, unit) for one in kind.limits.obstacles], np.int64)
            .reshape(-1, 2, 3) for kind in job.bins
        ),
        gap=math.ceil(exact(rules.gap) / unit),
        overhang=math.floor(exact(rules.overhang) / unit),
        layer=np.unique(np.array(carriers), axis=0, return_inverse=True)[1].ravel(),
    )  # fmt: skip


def _ends(one: Obstacle, job: Job, unit: Fraction) -> list[list[int]]:
    ends = [[0, 0, 0], [1, 1, 1]]  # in 2D everything is as deep as the bin
    for axis in job.axes:
        low = exact(one.corner[axis])
        ends[0][axis] = math.floor(low / unit)
        ends[1][axis] = math.ceil((low + exact(one.size[axis])) / unit)
    return ends


def _codes(names: Iterable[Hashable]) -> np.ndarray:
    known: dict[Hashable, int] = {"": -1}
    return np.array([known.setdefault(name, len(known) - 1) for name in names], np.int64)


def _or(number: int | None, otherwise: int) -> int:
    return otherwise if number is None else number
