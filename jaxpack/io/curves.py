"""A picture of how the runs of a sweep went."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from jaxpack.io.atomic import replace_file

Curve = tuple[np.ndarray, np.ndarray]
"""Updates [T], and a figure of every run at each of them [runs, T], NaN where it has diverged."""


def draw_curves(path: Path, panels: Mapping[str, Mapping[str, Curve]]) -> None:
    """Writes a PNG: of every setting the mean over its runs, and in a lighter shade their range.

    Args:
        path: the file to write.
        panels: title of a panel -> setting -> curve.
    """
    figure = Figure(figsize=(5.5 * len(panels), 4), layout="constrained")
    colours = matplotlib.colormaps["tab10"].colors  # type: ignore[attr-defined]
    for axis, (title, curves) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        for number, (setting, (updates, values)) in enumerate(curves.items()):
            colour = colours[number % len(colours)]
            dashes = ("-", "--", ":", "-.")[number // len(colours) % 4]
            low, high = np.nanmin(values, 0), np.nanmax(values, 0)
            axis.fill_between(updates, low, high, color=colour, alpha=0.2, linewidth=0)
            axis.vlines(updates, low, high, color=colour, alpha=0.4)  # where there is one update
            axis.plot(
                updates,
                np.nanmean(values, 0),
                dashes,
                color=colour,
                marker=".",
                label=setting or "runs",
            )
        axis.set(title=title, xlabel="updates")
    axis.legend(fontsize=8)
    with replace_file(path, "wb") as file:
        figure.savefig(file, format="png", dpi=110)
