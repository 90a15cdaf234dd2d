"""What a process that searches is asked for, and what it answers."""

from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import Genes, Loading


class Request(NamedTuple):
    """A job to search, until the time or the packings are used up or something else is received."""

    loading: Loading
    seed: int
    seconds: float
    first: Genes  # of one lane: where the search begins besides the sorts
    policy: str  # name of a shipped policy that draws orders for it, "" for none
    packings: int | None = None  # that may be tried at most


class Found(NamedTuple):
    """The best packing so far, rows as those of the job."""

    genes: Genes
    bin: np.ndarray  # int32 [N]
    corner: np.ndarray  # int32 [N, 3]
    cost: float
    packings: int  # tried since the last one


STOP = "stop"
"""Asks for the end of a search."""
DONE = "done"
"""Answers at the end of every search: the process waits for the next request."""
STARTED = "started"
"""Comes before anything else: from now on the process can be halted."""
