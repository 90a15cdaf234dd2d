"""A page on which what a simulation of a plan did is stepped through: the page of the plan, where
items leave their places.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from jaxpack.io.colours import item_colours
from jaxpack.io.viewer import shown_of, write_page
from jaxpack.model.job import Job, Plan
from jaxpack.model.physics import Moved

RED = "#d62728"  # what moved; everything else is pale
PALE = 0.7  # of the way to white
SEEN = math.radians(1)  # what turns by less than this is not seen to turn


class Film:
    """The moments of a simulation: of each item those after which it was seen somewhere else."""

    def __init__(self, job: Job, plan: Plan, least: float) -> None:
        """Takes what is to be seen.

        Args:
            job: what was packed.
            plan: of it.
            least: items that are displaced by more than this, in the job's unit of length, are
                shown as moved, and to have moved in steps of a tenth of it.
        """
        self.job, self.plan, self.least = job, plan, least
        self.moments = 0
        self.last = [0 for _ in plan.bins]  # moment of each bin
        self.items: list[list[dict[str, Any]]] = [[] for _ in plan.bins]

    def see(self, number: int, centre: np.ndarray, rotation: np.ndarray) -> None:
        """Adds a moment: what `simulate` calls with bin, centres [k, 3] and rotations [k, 3, 3]."""
        self.moments += 1
        self.last[number] = self.moments
        shown, puts = self.items[number], self.plan.bins[number].placements
        for put in puts[len(shown) : len(centre)]:
            pose = {"step": self.moments, "corner": put.corner, "turn": np.eye(3).tolist()}
            shown.append({"step": self.moments, "poses": [pose]})
        for item, put, middle, turn in zip(shown, puts, centre, rotation, strict=False):
            size = np.array(self.job.items[put.item].turned(put.orientation))
            corner, before = middle - turn @ size / 2, item["poses"][-1]
            far = abs(corner - before["corner"]).max() > self.least / 10
            if far or abs(turn - before["turn"]).max() > SEEN:
                pose = {"corner": corner.round(6).tolist(), "turn": turn.round(6).tolist()}
                item["poses"].append({"step": self.moments, **pose})

    def write_html(self, path: Path, found: Moved) -> None:
        """Writes the page, standalone like that of a plan.

        Args:
            path: the file to write.
            found: what the simulation came to.
        """
        shown, colours = shown_of(self.job, self.plan), item_colours(self.job)
        shown["moments"] = self.moments
        for number, (one, items) in enumerate(zip(shown["bins"], self.items, strict=True)):
            one["last"] = self.last[number]
            distances = found.distance[found.bin == number].tolist()
            for item, seen, by in zip(one["items"], items, distances, strict=True):
                moved = by > self.least
                colour = RED if moved else _paler(colours[item["type"]])
                item |= seen | {"moved": by if moved else None, "color": colour}
        write_page(path, self.job.name or "Loading plan under gravity", shown)


def _paler(colour: str) -> str:
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(255 * PALE + part * (1 - PALE)):02x}" for part in parts)
