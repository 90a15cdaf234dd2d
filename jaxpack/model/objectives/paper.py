"""The paper's R: how compactly the bins are filled, whatever their number. On a grid alone."""

from typing import Any

from jaxpack.model.objectives.base import Objective


def _on_grid(*packing: Any) -> Any:
    from jaxpack.model.metrics import paper_cost  # JAX, which orders can do without

    return paper_cost(*packing)


PAPER = Objective(minimised="R of Eq. (9) of the paper", on_grid=_on_grid)
