"""Pictures of packings, as in the paper's Fig. 7 and 8: a row per method, a column per bin."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from jax.typing import ArrayLike

from jaxpack.files.atomic import replace_file
from jaxpack.packing.problem import Instance, Packing


def draw_packings(path: Path, instance: Instance, packings: Sequence[tuple[str, Packing]]) -> None:
    """Writes a PNG of packings of one instance; an item has the same colour in each.

    Args:
        path: the file to write.
        instance: one instance, no batch axis.
        packings: (label, packing) per row of the picture.
    """
    room = np.asarray(instance.bin)
    flat = bool(room[1] == 1)
    size, mask = np.asarray(instance.size), np.asarray(instance.mask)
    colours = plt.get_cmap("tab20")(np.linspace(0, 1, len(size)))
    columns = max(int(np.asarray(packing.bin).max()) + 1 for _, packing in packings)
    figure, axes = plt.subplots(
        len(packings),
        columns,
        figsize=(2.1 * columns + 0.8, 2.1 * len(packings) + 0.3),
        squeeze=False,
        subplot_kw={} if flat else {"projection": "3d"},
        layout="constrained",
    )
    for row, (label, packing) in zip(axes, packings, strict=True):
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
    plt.close(figure)


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
    )
    axis.set(xlim=(0, room[0]), ylim=(0, room[2]), aspect="equal", xticks=[], yticks=[])


def _draw_solid(
    axis: Any, room: np.ndarray, corner: np.ndarray, size: np.ndarray, colours: ArrayLike
) -> None:
    axis.bar3d(*corner.T, *size.T, color=colours, edgecolor="black", linewidth=0.3, shade=True)
    axis.set(xlim=(0, room[0]), ylim=(0, room[1]), zlim=(0, room[2]))
    axis.set(xticks=[], yticks=[], zticks=[])
    axis.set_box_aspect(room)
    axis.view_init(elev=28, azim=-55)
