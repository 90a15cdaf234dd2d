"""Records of a training as curves for TensorBoard, where it is installed."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

Log = Callable[[dict[str, Any]], object]
"""Takes a record of metrics.jsonl, see `jaxpack.training.train_run`."""


@contextmanager
def tensorboard(run: str | PathLike[str]) -> Iterator[Log]:
    """A log that writes what is measured to RUN/tensorboard, or nothing without the extra."""
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        yield lambda record: None
        return
    board = SummaryWriter(str(Path(run) / "tensorboard"))

    def log(record: dict[str, Any]) -> None:
        kind, figures = "train", {k: v for k, v in record.items() if isinstance(v, float)}
        if "validation" in record:
            kind, figures = "validation", record["validation"]
        for name, value in figures.items():
            board.add_scalar(f"{kind}/{name}", value, record["update"])

    try:
        yield log
    finally:
        board.close()
