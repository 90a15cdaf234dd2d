"""What a reader or a writer assumed, said in one line each to whoever wants to hear it."""

from collections.abc import Callable

from jaxpack.model.numbers import fault

Say = Callable[[str], object]
"""Takes a line, such as the `append` of a list or what prints it on standard error."""


def silent(line: str) -> None:
    """Says nothing."""


def note(*parts: object) -> str:
    """One printable line that says `parts`."""
    return str(fault(*parts))
