"""Colours of items, the same in pictures and on pages."""

from jaxpack.model.job import Job

COLOURS = (
    "#1f77b4", "#aec7e8", "#ff7f0e", "#ffbb78",
    "#2ca02c", "#98df8a", "#d62728", "#ff9896",
    "#9467bd", "#c5b0d5", "#8c564b", "#c49c94",
    "#e377c2", "#f7b6d2", "#7f7f7f", "#c7c7c7",
    "#bcbd22", "#dbdb8d", "#17becf", "#9edae5",
)  # fmt: skip
"""Ten hues, each dark and light: matplotlib's tab20."""


def item_colours(job: Job) -> list[str]:
    """A colour per item type, as #rrggbb; they repeat where there are more types than colours."""
    return [COLOURS[index % len(COLOURS)] for index in range(len(job.items))]
