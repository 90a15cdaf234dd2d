"""Pictures of packings: a comparison of methods as in the paper's Fig. 7 and 8, and one plan."""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jax.typing import ArrayLike
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jaxpack.io.atomic import replace_file
from jaxpack.io.colours import COLOURS, item_colours
from jaxpack.model.figures import fill
from jaxpack.model.job import Job, Plan
from jaxpack.model.problem import Instance, Packing

MOST_BINS = 30  # in one picture of a plan
PER_ROW = 5
OBSTACLE = "#77777780"
EDGE: dict[str, Any] = {
    "color": "#cc0000",
    "linewidth": 2,
}  # of the floor, where items reach out over it
VIEWER = np.array([1, -1, 1])  # the signs of the direction in which the viewer of a solid bin is


def draw_packings(path: Path, packings: Sequence[tuple[str, Instance, Packing]]) -> None:
    """Writes a PNG of packings of one instance; an item has the same colour in each.

    Args:
        path: the file to write.
        packings: (label, instance, packing) per row of the picture, no batch axis; the instance
            turned as it is packed.
    """
    first = packings[0][1]
    room, mask = np.asarray(first.bin), np.asarray(first.mask)
    flat = bool(room[1] == 1)
    colours = matplotlib.colormaps["tab20"](np.linspace(0, 1, len(mask)))
    columns = max(int(np.asarray(packing.bin).max()) + 1 for *_, packing in packings)
    figure, axes = _panels(
        len(packings), columns, (2.1 * columns + 0.8, 2.1 * len(packings) + 0.3), flat
    )
    for row, (label, instance, packing) in zip(axes, packings, strict=True):
        size = np.asarray(instance.size)
        bins, corner = np.asarray(packing.bin), np.asarray(packing.position)
        used = int(bins.max()) + 1
        for number, axis in enumerate(row):
            if number >= used:
                axis.set_axis_off()
                continue
            inside = np.flatnonzero(mask & (bins == number))
            draw = _draw_flat if flat else _draw_solid
            draw(axis, room, corner[inside], size[inside], colours[inside])
            fill = size[inside].prod(1).sum() / room.prod()
            axis.set_title(f"bin {number + 1}: {fill:.0%}", fontsize=8)
        text = f"{label}\n{used} bins"
        if flat:
            row[0].set_ylabel(text)
        else:
            row[0].text2D(-0.1, 0.5, text, transform=row[0].transAxes, rotation=90, va="center")
    with replace_file(path, "wb") as file:
        figure.savefig(file, format="png", dpi=110)


def write_png(path: Path, job: Job, plan: Plan) -> None:
    """Writes a PNG of a plan for a report: its first 30 bins, with a colour per item type.

    Bins and items have the numbers that they have in the plan's files, from 0.
    """
    flat = job.dimension == 2
    bins = plan.bins[:MOST_BINS]
    columns = min(PER_ROW, max(1, len(bins)))
    rows = max(1, math.ceil(len(bins) / columns))
    used = sorted({placed.item for packed in bins for placed in packed.placements})
    legend = used if len(job.items) <= len(COLOURS) else []  # where a colour stands for one type
    entries = max(2, columns)  # of the legend in a line
    height = 2.5 * rows + 0.2 * math.ceil(len(legend) / entries) + 0.4
    figure, axes = _panels(rows, columns, (max(4.0, 2.4 * columns), height), flat)
    colours = np.array(item_colours(job))
    for axis in axes.flat[len(bins) :]:
        axis.set_axis_off()
    for number, (axis, packed) in enumerate(zip(axes.flat, bins, strict=False)):
        kind = job.bins[packed.bin]
        inside, taken = packed.placements, kind.limits.obstacles
        sizes = [job.items[p.item].turned(p.orientation) for p in inside]
        draw = _draw_flat if flat else _draw_solid
        draw(
            axis,
            np.array(kind.size),
            np.array([p.corner for p in inside] + [o.corner for o in taken]).reshape(-1, 3),
            np.array(sizes + [o.size for o in taken]).reshape(-1, 3),
            np.array([*colours[[placed.item for placed in inside]], *(OBSTACLE for _ in taken)]),
        )
        name = f" ({_short(kind.name)})" if kind.name else ""
        text = f"bin {number}{name}: {fill(job, packed):.0%}"
        axis.set_title(text, fontsize=8, parse_math=False)
    if not bins:
        figure.suptitle("no bin is used")
    elif len(plan.bins) > len(bins):
        figure.supxlabel(f"and {len(plan.bins) - len(bins)} more")
    if legend:
        names = [_short(job.items[index].name or f"item {index}") for index in legend]
        box = figure.legend(
            handles=[Patch(color=c, label=n) for c, n in zip(colours[legend], names, strict=True)],
            loc="outside lower center",
            ncols=entries,
            fontsize=8,
        )
        for line in box.get_texts():
            line.set_parse_math(False)
    with replace_file(path, "wb") as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a name: a box is shown for it
        figure.savefig(file, format="png", dpi=110)


def _panels(
    rows: int, columns: int, inches: tuple[float, float], flat: bool
) -> tuple[Figure, np.ndarray]:
    """A figure of its own, which pyplot, its windows and its backend know nothing of."""
    figure = Figure(figsize=inches, layout="constrained")
    kind = {} if flat else {"projection": "3d"}
    return figure, figure.subplots(rows, columns, squeeze=False, subplot_kw=kind)


def _short(name: str) -> str:
    name = "".join(c if c.isprintable() else "?" for c in name)
    return name if len(name) <= 20 else name[:19] + "…"


def _draw_flat(
    axis: Any, room: np.ndarray, corner: np.ndarray, size: np.ndarray, colours: ArrayLike
) -> None:
    axis.bar(
        corner[:, 0],
        size[:, 2],
        width=size[:, 0],
        bottom=corner[:, 2],
        align="edge",
        color=colours,
        edgecolor="black",
        linewidth=0.6,
        hatch=["///" if str(colour) == OBSTACLE else "" for colour in np.asarray(colours)],
    )
    low, high = _extent(room, corner, size)
    if (low < 0).any() or (high > room).any():
        axis.plot([0, room[0]], [0, 0], clip_on=False, **EDGE)
    axis.set(xlim=(low[0], high[0]), ylim=(0, room[2]), aspect="equal", xticks=[], yticks=[])


def _draw_solid(
    axis: Any, room: np.ndarray, corner: np.ndarray, size: np.ndarray, colours: ArrayLike
) -> None:
    # The axes sort faces by their middles, which puts a long box before what hides it.
    axis.computed_zorder = False
    for order, index in enumerate(_back_to_front(corner, size)):
        axis.bar3d(
            *corner[index],
            *size[index],
            color=np.asarray(colours)[index],
            edgecolor="black",
            linewidth=0.3,
            shade=True,
            zorder=order,
        )
    low, high = _extent(room, corner, size)
    if (low < 0).any() or (high > room).any():
        x, y = room[0] * np.array([0, 1, 1, 0, 0]), room[1] * np.array([0, 0, 1, 1, 0])
        axis.plot(x, y, 0, zorder=-1, **EDGE)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(0, room[2]))
    axis.set(xticks=[], yticks=[], zticks=[])
    axis.set_box_aspect(high - low)
    axis.view_init(elev=28, azim=-55)
    axis.set_proj_type("ortho")


def _extent(
    room: np.ndarray, corner: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What the bin and its items take up: from where to where."""
    low, high = corner.min(0, initial=0), (corner + size).max(0, initial=0)
    return np.minimum(low, 0), np.where(high > room * (1 + 1e-9), high, room)


def _back_to_front(corner: np.ndarray, size: np.ndarray) -> list[int]:
    """The order in which boxes can be painted over each other."""
    ends = np.stack([corner * VIEWER, (corner + size) * VIEWER])
    far, near = ends.min(0), ends.max(0)  # of each box along each axis, for the viewer
    touch = 1e-6 * np.abs(ends).max(initial=0)
    behind = (near[:, None] <= far + touch).any(-1)  # a plane parts [this one, from that before it]
    first = behind & ~behind.T  # both ways: neither hides any of the other
    waits, order = first.sum(0), []
    for _ in corner:
        order.append(int(waits.argmin()))  # 0, but for boxes that hide each other in a ring
        waits -= first[order[-1]]
        waits[order[-1]] = 2 * len(corner)  # done
    return order
