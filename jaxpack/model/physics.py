"""Does a plan stand? Its items as rigid boxes under gravity, in MuJoCo (the extra `physics`).

A witness that shares nothing with the rules by which plans are made and checked: it knows weight
and friction, and no share of a base. Every bin is a world of its own, scaled so that its longest
side is a metre, in which MuJoCo's tolerances and steps are of the right size.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.job import Job, PackedBin, Placement, Plan, Sides

FRICTION = 0.5  # cardboard on cardboard or on a wooden pallet: UN/ECE's CTU Code, appendix 2
STEP = 0.001  # seconds
PAUSE = 0.2  # seconds between two items: one that tips has moved a centimetre by then
REST = 2.0  # seconds after the last one
SHOWN = 0.1  # seconds between two looks at the items that come to rest
SLACK = 3e-3
"""Share of an item's least side by which it is shorter along x and y, and let go above its place.

Faces that touch exactly would hold an item that leans by friction, like a cork, and one that is
carried by exactly half would stand on a knife's edge. Less of it, and what has come to lean on a
neighbour's place by a hair keeps that one from getting there.
"""
LEAST = 2e-4  # metres: the inertia of what is smaller is nothing to MuJoCo
DEPTH = 0.1  # metres along y of the items of a 2D plan, which stay in their plane
FALL = 0.1  # metres from the floor of a bin to the ground around it
STIFF = (0.003, 1.0), (0.998, 0.9995, 0.001, 0.5, 2.0)
"""MuJoCo's solref and solimp of contacts: as hard as three steps allow, so that a tower of ten
sinks by less than a ten thousandth of its bin."""
GRIP = 10.0  # MuJoCo's impratio, with elliptic cones: what leans would creep without
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])

Seen = Callable[[int, np.ndarray, np.ndarray], None]


class Moved(NamedTuple):
    """Where the items of a plan are once they have come to rest. Rows in loading order, by bin."""

    bin: np.ndarray  # int64 [n], number of the bin in the plan
    turn: np.ndarray  # int64 [n], how many items the bin held when it was loaded
    item: np.ndarray  # int64 [n], index in Job.items
    centre: np.ndarray  # float64 [n, 3], in the job's unit of length
    rotation: np.ndarray  # float64 [n, 3, 3], from how it lay in the plan
    distance: np.ndarray  # float64 [n], how far the corner that moved most is from its place


def simulate(
    job: Job,
    plan: Plan,
    *,
    friction: float = FRICTION,
    at_once: bool = False,
    walls: bool = False,
    seen: Seen | None = None,
) -> Moved:
    """Loads the bins of a plan, each by itself, and says how far its items have moved.

    An item appears just above its place, or above what is in the way there, and has 0.2 seconds
    before the next one; after the last one there are two more.

    Args:
        job: what was packed.
        plan: of it, valid or not. One of 2D is seen from the front: nothing leaves its plane.
        friction: between items, and between items and the floor; 0 to 1.
        at_once: all items of a bin are in their places from the start.
        walls: the bin has four walls, beside its floor or what reaches out over it. Otherwise what
            is pushed over an edge of the floor falls to the ground around it.
        seen: called after every item that is loaded, and ten times a second after the last one,
            with the number of the bin, centres [k, 3] and rotations [k, 3, 3] of its first k items.

    Raises:
        UserError: MuJoCo is not installed, the friction is not from 0 to 1, or the items of a bin
            are thrown about beyond all numbers.
    """
    check_friction("friction", friction)
    weights, none = _weights(job), np.zeros(0, np.int64)
    parts = [Moved(none, none, none, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))]
    for number, packed in enumerate(plan.bins):
        world = _World(job, packed, friction, walls)
        for _ in _moments(world, packed, weights, at_once):
            if world.broken():
                what = "its items are thrown about beyond all numbers: is the plan valid"
                raise UserError(f"bin {number}: {what}, and are the weights?")
            if seen is not None:
                seen(number, *world.poses())
        parts.append(_moved(job, packed, number, *world.poses()))
    return Moved(*map(np.concatenate, zip(*parts, strict=True)))


def check_friction(what: str, friction: float) -> None:
    """Raises UserError, which begins with `what`, where contacts would be soft, or no number is."""
    if not 0 <= friction <= 1:
        raise UserError(f"{what} {friction}: give a number from 0 to 1")


def _moments(
    world: "_World", packed: PackedBin, weights: np.ndarray, at_once: bool
) -> Iterator[None]:
    """Loads a bin and lets it rest, bit by bit."""
    for put in packed.placements:
        world.add(put, weights[put.item], at_once)
        if not at_once:
            world.run(PAUSE)
            yield
    for _ in range(round(REST / SHOWN)):
        world.run(SHOWN)
        yield


def _moved(
    job: Job, packed: PackedBin, number: int, centre: np.ndarray, rotation: np.ndarray
) -> Moved:
    """The rows of one bin."""
    low, size = _places(job, packed)
    corners = CORNERS * size[:, None]
    moved = (centre - low - size / 2)[:, None] + corners @ rotation.swapaxes(1, 2) - corners
    items = np.array([put.item for put in packed.placements], np.int64)
    distance = np.linalg.norm(moved, axis=2).max(1)
    numbers = np.full(len(items), number), np.arange(len(items)), items
    return Moved(*numbers, centre, rotation, distance)


def _places(job: Job, packed: PackedBin) -> tuple[np.ndarray, np.ndarray]:
    """Near corners and extents [n, 3], in the job's unit."""
    puts = packed.placements
    low = np.array([put.corner for put in puts], float).reshape(-1, 3)
    sizes = [job.items[put.item].turned(put.orientation) for put in puts]
    return low, np.array(sizes, float).reshape(-1, 3)


def _weights(job: Job) -> np.ndarray:
    """Of each item type; the heaviest has 1, as only what one weighs beside others matters here.

    Without any weight it is the volume; what has none among others that do has a tenth of the
    least. No weight is less than a thousandth, or a contact with what is so much heavier gives way.
    """
    weights = np.array([item.weight for item in job.items])
    if not weights.any():
        weights = np.array([np.prod(item.size) for item in job.items])
    weights = np.where(weights > 0, weights, weights[weights > 0].min() / 10)
    return np.maximum(weights / weights.max(), 1e-3)


class _World:
    """A bin in MuJoCo, in metres of its own."""

    def __init__(self, job: Job, packed: PackedBin, friction: float, walls: bool) -> None:
        try:
            import mujoco  # not for those who simulate nothing
        except ModuleNotFoundError:
            what = "MuJoCo is not installed"
            raise UserError(f"{what}: pip install 'jaxpack[physics]'") from None
        if mujoco.get_mju_user_warning() is None:  # it would write a file where the program runs
            mujoco.set_mju_user_warning(lambda _: None)
        self.mujoco, self.job, self.friction = mujoco, job, friction
        self.flat = job.dimension == 2
        room = np.array(job.room(packed))
        self.scale = 1 / room[list(job.axes)].max()
        self.half = np.zeros((0, 3))  # of the items that are in it
        self.spec = mujoco.MjSpec()
        option = self.spec.option
        option.timestep, option.impratio = STEP, GRIP
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        floor = (0, 0, -FALL / self.scale), (room[0], room[1], FALL / self.scale)
        taken = [(one.corner, one.size) for one in job.bins[packed.bin].limits.obstacles]
        fixed = [self._scaled(*box) for box in (floor, *taken)]
        self.taken = np.array([(low + size / 2, size / 2) for low, size in fixed]).swapaxes(0, 1)
        for centre, half in self.taken.swapaxes(0, 1):
            kind = mujoco.mjtGeom.mjGEOM_BOX
            self._surface(self.spec.worldbody.add_geom(type=kind, size=half, pos=centre))
        ground = [((0, 0, -FALL), (0, 0, 1))]  # a point and what is upwards of it
        if walls:
            low, size = _places(job, packed)
            near = low.min(0, initial=0) * self.scale
            far = np.maximum((low + size).max(0, initial=0), room) * self.scale
            ground += [(near, (1, 0, 0)), (far, (-1, 0, 0))]
            ground += [(near, (0, 1, 0)), (far, (0, -1, 0))] * (not self.flat)
        for point, up in ground:
            kind = mujoco.mjtGeom.mjGEOM_PLANE
            self._surface(self.spec.worldbody.add_geom(type=kind, size=[0, 0, 1], pos=point), up)
        self.model: Any = None
        self.data: Any = None
        self.compiled = -1  # items that the model has

    def _surface(self, geom: Any, up: tuple[float, ...] | None = None) -> None:
        geom.friction = [self.friction, 0, 0]
        geom.solref, geom.solimp = STIFF
        if up is not None:
            geom.alt.type, geom.alt.zaxis = self.mujoco.mjtOrientation.mjORIENTATION_ZAXIS, up

    def _scaled(self, corner: Sides, size: Sides) -> tuple[np.ndarray, np.ndarray]:
        """Corner and sides of a box in this world."""
        low, sides = np.array(corner) * self.scale, np.array(size) * self.scale
        if self.flat:
            low[1], sides[1] = 0, DEPTH
        return low, sides

    def add(self, put: Placement, weight: float, in_place: bool) -> None:
        """Puts one more item into it, in its place or just above what it would touch."""
        low, size = self._scaled(put.corner, self.job.items[put.item].turned(put.orientation))
        size = np.maximum(size, LEAST)
        slack = SLACK * size.min()
        half = (size - [slack, slack, 0]) / 2
        centre = low + size / 2
        if not in_place:
            centre[2] = max(low[2], self._top(centre, half)) + size[2] / 2 + slack
        body = self.spec.worldbody.add_body(pos=centre)
        if self.flat:
            joint = self.mujoco.mjtJoint
            for axis in ((1, 0, 0), (0, 0, 1)):
                body.add_joint(type=joint.mjJNT_SLIDE, axis=axis)
            body.add_joint(type=joint.mjJNT_HINGE, axis=(0, 1, 0))
        else:
            body.add_freejoint()
        kind = self.mujoco.mjtGeom.mjGEOM_BOX
        self._surface(body.add_geom(type=kind, size=half, mass=weight))
        self.half = np.vstack([self.half, half])

    def _compile(self) -> None:
        """Gives the model what was added; the others are where they were."""
        if self.model is None:
            self.model = self.spec.compile()
            self.data = self.mujoco.MjData(self.model)
        elif self.compiled < len(self.half):
            self.model, self.data = self.spec.recompile(self.model, self.data)
        self.compiled = len(self.half)

    def _top(self, centre: np.ndarray, half: np.ndarray) -> float:
        """The highest point of what is over or under a base, as far as its items are upright."""
        at, rotation = self._poses()
        reach = (abs(rotation) @ self.half[:, :, None])[..., 0]
        at, reach = np.concatenate([self.taken[0], at]), np.concatenate([self.taken[1], reach])
        meets = (abs(at - centre) < reach + half)[:, :2].all(1)
        return float((at + reach)[meets, 2].max(initial=0.0))

    def run(self, seconds: float) -> None:
        """Lets time pass."""
        self._compile()
        self.mujoco.mj_step(self.model, self.data, round(seconds / STEP))

    def _poses(self) -> tuple[np.ndarray, np.ndarray]:
        self._compile()
        self.mujoco.mj_kinematics(self.model, self.data)
        return self.data.xpos[1:].copy(), self.data.xmat[1:].reshape(-1, 3, 3).copy()

    def poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres, in the job's unit, and rotations of its items."""
        centre, rotation = self._poses()
        centre = centre / self.scale
        if self.flat:
            centre[:, 1] = 0.5
        return centre, rotation

    def broken(self) -> bool:
        """Whether numbers became too large, or room for contacts ran out."""
        return any(warning.number for warning in self.data.warning)
