"""What a process that searches is asked for, and what it answers."""

from typing import NamedTuple

from jaxpack.model.encoding import Genes, Loading
from jaxpack.search.local_search import Best


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

    best: Best
    packings: int  # tried since the last one


STOP = "stop"
"""Asks for the end of a search."""
DONE = "done"
"""Answers at the end of every search: the process waits for the next request."""
STARTED = "started"
"""Comes before anything else: from now on the process can be halted."""
