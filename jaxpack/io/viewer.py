"""A page of a plan that opens in any browser, without a network: bins to turn, zoom and load."""

import html
import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jaxpack.io.atomic import replace_file
from jaxpack.io.colours import item_colours
from jaxpack.model.figures import fill
from jaxpack.model.job import Job, PackedBin, Plan
from jaxpack.model.limits import ItemLimits


def write_html(path: Path, job: Job, plan: Plan, title: str = "") -> None:
    """Writes a standalone page (5 MB: the library that draws is in it) that shows a plan.

    Bins and items have the numbers that they have in the plan's files, from 0; steps are from 1.

    Args:
        path: the file to write.
        job: what had to be packed.
        plan: a packing of it.
        title: the page's heading; the job's name if not given.
    """
    write_page(path, title or job.name or "Loading plan", shown_of(job, plan))


def write_page(path: Path, title: str, shown: Mapping[str, Any]) -> None:
    """Writes the page of what `shown_of` gave, of which more may be said."""
    page = html_page(title, _json(shown))
    with replace_file(path, "wb") as file:
        file.write(page)


def html_page(title: str, shown: str) -> bytes:
    """The page of a plan, from what `shown_plan` gave of it."""
    from plotly.offline import get_plotlyjs  # half a second to import

    parts = {"title": html.escape(title), "plan": shown, "plotly": get_plotlyjs()}
    template = resources.files("jaxpack.io").joinpath("viewer.html").read_text("utf-8")
    # One pass: a name that reads like a placeholder stays as it is.
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)
    # A title from a file's name may be no proper Unicode.
    return page.encode("utf-8", "xmlcharrefreplace")


def shown_plan(job: Job, plan: Plan) -> str:
    """What the page of a plan shows, as JSON in which no name can end a script or open another."""
    return _json(shown_of(job, plan))


def _json(shown: Mapping[str, Any]) -> str:
    return json.dumps(shown, allow_nan=False).replace("<", "\\u003c")


def shown_of(job: Job, plan: Plan) -> dict[str, Any]:
    """What the script of the page draws."""
    names = [item.name or f"item {index}" for index, item in enumerate(job.items)]
    return {
        "flat": job.dimension == 2,
        "types": [
            {
                "name": name,
                "size": item.size,
                "weight": item.weight,
                "color": colour,
                "limits": _told(item.limits),
            }
            for name, item, colour in zip(names, job.items, item_colours(job), strict=True)
        ],
        "bins": [_shown_bin(job, packed) for packed in plan.bins],
        "leftOut": [[names[item], copies] for item, copies in Counter(plan.left_out).items()],
    }


def _told(limits: ItemLimits) -> list[str]:
    """What is asked of an item, a line each."""
    lines = {
        f"stop {limits.stop}": limits.stop is not None,
        f"group {limits.group}": limits.group,
        f"apart {limits.apart}": limits.apart,
        "on the floor": limits.floor,
        "nothing on it": not limits.stackable,
        f"carries {limits.weight_above:.13g}": limits.weight_above < math.inf,
        f"in stacks of {limits.most_in_stack}": limits.most_in_stack,
        f"stack id {limits.stack_id}": limits.stack_id,
    }
    return [line for line, asked in lines.items() if asked]


def _shown_bin(job: Job, packed: PackedBin) -> dict[str, Any]:
    kind = job.bins[packed.bin]
    return {
        "type": kind.name or f"type {packed.bin}",
        "size": kind.size,
        "obstacles": [{"corner": one.corner, "size": one.size} for one in kind.limits.obstacles],
        "fill": fill(job, packed),
        "weight": sum(job.items[placed.item].weight for placed in packed.placements),
        "maxWeight": kind.max_weight if math.isfinite(kind.max_weight) else None,
        "items": [
            {
                "type": placed.item,
                "size": job.items[placed.item].turned(placed.orientation),
                "corner": placed.corner,
                "orientation": placed.orientation,
            }
            for placed in packed.placements
        ],
    }
