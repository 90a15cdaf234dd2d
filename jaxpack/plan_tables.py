"""What `python -m jaxpack.solve` says of a plan: its live line, its figures, its table."""

import math
from collections import Counter
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from jaxpack.model.job import BinType, Job
from jaxpack.model.objectives import objective_of
from jaxpack.search.record import Progress
from jaxpack.solution import Solution

LISTED = 60  # orders, a row for each; of more there are the sums alone
NAMED = 5  # of many things the first few are named


class Screen(Console):
    """Standard output, or standard error; who reads neither any more ends the program."""

    def __init__(self, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False)

    def on_broken_pipe(self) -> None:
        """Leaves it to the door, where rich would end with the code of a plan that is not valid."""
        raise BrokenPipeError


def live_figures(found: Progress) -> str:
    """The live line. In floats: exact figures of a large plan take seconds."""
    job = found.job
    room = sum(math.prod(job.room(packed)) for packed in found.plan.bins)
    items = (put.item for packed in found.plan.bins for put in packed.placements)
    fill = sum(math.prod(job.items[item].size) for item in items) / room if room else 0.0
    parts, goal = [counted(found.bins, "bin"), f"fill {_percent(fill)}"], objective_of(job)
    if goal.figure:
        parts.insert(0, f"{goal.figure} {_number(found.measure)}")
    if found.plan.left_out and not goal.leaves_out:  # the bound may be that of a larger load
        parts.append(f"{counted(len(found.plan.left_out), 'item')} left out")
    else:
        parts.append("gap unknown" if found.gap is None else f"gap {_percent(found.gap)}")
    return ", ".join(parts)


def figures_of_one(found: Solution) -> dict[str, str]:
    """What a plan amounts to, by the name of the figure."""
    job, figures = found.job, found.figures
    rows = {"bins": f"{figures.bins:,}{_kinds(job, found)}", "fill": _percent(figures.utilisation)}
    if any(item.weight for item in job.items):
        rows["weight"] = _number(figures.weight)
    if job.priced:
        rows["cost"] = f"{_number(figures.cost)}, at least {_number(found.least_cost)}"
    goal, above = objective_of(job), "" if found.gap is None else f", gap {_percent(found.gap)}"
    if goal.figure:
        of = f" of {_number(goal.total(job))}" if goal.total else ""
        bound = f"at {'most' if goal.maximised else 'least'} {_number(found.bounds.best)}"
        rows[goal.figure] = f"{_number(goal.measure(job, found.plan))}{of}, {bound}{above}"
    else:
        rows["lower bound"] = f"{counted(found.bound, 'bin')}{above}"
    rows["search"] = f"{found.seconds:.1f} s, {found.packings:,} packings tried"
    rows["limited by"] = found.limited_by
    if figures.left_out:
        counts = Counter(
            job.items[item].name or f"item {item}" for item in sorted(found.plan.left_out)
        )
        rows["left out"] = f"{counted(figures.left_out, 'item')} ({_names_of(counts)})"
    if found.unpacked:
        rows["of these"] = (
            f"{counted(found.unpacked, 'item')} would fit: {found.lacking.split(';')[0]}"
        )
    if len(job.bins) > 1:
        rows["minimised"] = goal.minimised
    if job.rounded:
        rows["lengths"] = f"are cut off to {job.rounded:g}: finer ones have too many digits"
    return rows


def table_of_many(solutions: Sequence[Solution]) -> Table:
    """A row per order."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("order", no_wrap=True)
    goals = [objective_of(found.job) for found in solutions]
    figure = [name for name in (goals[0].figure,) if name]  # of all orders of a file
    for name in (
        "items",
        "left out",
        "bins",
        *figure,
        "bound",
        "gap",
        "fill",
        "weight",
        "s",
        "packings",
    ):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("limited by", no_wrap=True)
    for found, goal in zip(solutions, goals, strict=True):
        figures = found.figures
        cells = [f"{found.job.count:,}", f"{figures.left_out:,}", f"{figures.bins:,}"]
        if figure:
            cells += map(_number, (goal.measure(found.job, found.plan), found.bounds.best))
        else:
            cells.append(f"{found.bound:,}")
        cells += ["" if found.gap is None else _percent(found.gap), _percent(figures.utilisation)]
        cells += [_number(figures.weight), f"{found.seconds:.1f}", f"{found.packings:,}"]
        table.add_row(plain_text(found.job.name), *cells, found.limited_by)
    return table


def figures_of_all(solutions: Sequence[Solution]) -> dict[str, str]:
    """What the plans of several orders amount to together."""
    bins, bound = sum(one.figures.bins for one in solutions), sum(one.bound for one in solutions)
    at_bound = sum(found.gap == 0 for found in solutions)
    above = f", gap {_percent(bins / bound - 1)}" if bound else ""
    rows = {
        "orders": f"{counted(len(solutions), 'order')}, {at_bound:,} of them at their bound",
        "bins": f"{bins:,}, at least {bound:,}{above}",
    }
    if any(found.job.priced for found in solutions):
        cost, least = (
            sum(one.figures.cost for one in solutions),
            sum(one.least_cost for one in solutions),
        )
        rows["cost"] = f"{_number(cost)}, at least {_number(least)}"
    if left_out := sum(found.figures.left_out for found in solutions):
        rows["left out"] = counted(left_out, "item")
    return rows


def _kinds(job: Job, found: Solution) -> str:
    """How many of each kind of bin, if there are several."""
    if len(job.bins) == 1:
        return ""
    counts = Counter(_called(job, job.bins[packed.bin]) for packed in found.plan.bins)
    return f" ({_names_of(counts)})"


def _called(job: Job, kind: BinType) -> str:
    axes = (0, 2) if job.dimension == 2 else (0, 1, 2)
    return kind.name or " x ".join(_number(kind.size[axis]) for axis in axes)


def _names_of(counts: Counter[str]) -> str:
    parts = [f"{count:,} of {name}" for name, count in counts.most_common(NAMED)]
    return ", ".join(parts) + (", ..." if len(counts) > NAMED else "")


def counted(number: int, thing: str) -> str:
    """1 bin, 2 bins."""
    return f"{number:,} {thing}{'s' * (number != 1)}"


def _percent(share: float) -> str:
    return f"{share * 100:.1f} %"


def _number(value: float) -> str:
    return f"{value:,.10g}"


def plain_text(line: str) -> Text:
    """A line in which names from files are neither markup nor commands to the terminal."""
    return Text("".join(c if c.isprintable() else "?" for c in line))


def print_table(console: Console, table: Table) -> None:
    """Prints a table wider than the terminal rather than with figures cut off."""
    wide = Measurement.get(console, console.options.update(max_width=200), table).maximum
    console.width = max(console.width, wide)
    console.print(table)


def print_solutions(console: Console, solutions: Sequence[Solution], several: bool) -> None:
    """One solution as a line per figure, several as a table with a row for each."""
    if several:
        if len(solutions) <= LISTED:
            print_table(console, table_of_many(solutions))
        for name, value in figures_of_all(solutions).items():
            say(console, f"{name:<13}{value}")
        return
    for found in solutions:
        for name, value in figures_of_one(found).items():
            say(console, f"{name:<13}{value}")


def say(console: Console, line: str) -> None:
    """Prints a line as long as it is, with nothing in it that the terminal would obey."""
    console.print(plain_text(line), soft_wrap=True)
