"""Position rules: of the positions where an item may stand, which one does it take?

A rule is a function of `Positions` that returns keys, arrays that broadcast with `Positions.z`:
the position with the least first key is taken, of equal ones that with the least second key, and
so on; what is then still equal goes by y, then by x. It uses operators and methods that NumPy's
and JAX's arrays share, so that one function serves every surface.

A rule of your own: ``RULES["mine"] = mine``, and ``Problem(..., rule="mine")``.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from jaxpack.errors import UserError
from jaxpack.packing.rules.far_corner import far_corner
from jaxpack.packing.rules.least_wasted import least_wasted
from jaxpack.packing.rules.lowest import lowest
from jaxpack.packing.rules.most_contact import most_contact
from jaxpack.packing.rules.nearest_corner import nearest_corner


class Positions(NamedTuple):
    """Where an item could stand: lengths in cells or units, arrays of X, Y and what is batched.

    Those that are not allowed are among them: what a rule says of them is not looked at.
    """

    x: Any  # [X, 1, *batch], of the corner
    y: Any  # [1, Y, *batch]
    z: Any  # [X, Y, *batch], where the item comes to rest
    size: tuple[Any, Any, Any]  # [*batch], length, width and height of the item
    room: tuple[Any, Any, Any]  # [*batch], of the bin
    contact: Callable[[], Any]  # float32 [X, Y, *batch]: area of its sides at walls or items
    waste: Callable[[], Any]  # float32 [X, Y, *batch]: volume below it that nothing fills


Rule = Callable[[Positions], tuple[Any, ...]]
"""Positions -> keys, the most important first."""

RULES: dict[str, Rule] = {
    "lowest": lowest,
    "nearest-corner": nearest_corner,
    "far-corner": far_corner,
    "most-contact": most_contact,
    "least-wasted": least_wasted,
}
"""Name -> rule."""


def as_decided(rule: Rule, x: Any, y: Any) -> Rule:
    """The rule of items that have a place of their own: there, where they may stand there.

    Args:
        rule: of those that have none.
        x, y: [*batch], of the corner, below 0 for none.
    """

    def keys(at: Any) -> tuple[Any, ...]:
        return ((at.x != x) | (at.y != y)).astype("int8"), *rule(at)

    return keys


def rule_named(name: str, called: str = "rule") -> Rule:
    """The rule with that name.

    Raises:
        UserError: there is none; it names those that there are.
    """
    if name not in RULES:
        raise UserError(f"{called} '{name}': choose {', '.join(RULES)}")
    return RULES[name]
