"""The Martello-Pisinger-Vigo benchmark: 3D instances made from POSIX random numbers.

Martello, Pisinger and Vigo, The three-dimensional bin packing problem, Operations Research 48
(2000); the same numbers as their published generator draws, so no file is needed.
"""

from jaxpack.errors import UserError
from jaxpack.model.job import BinType, ItemType, Job

SIDES = {1: 100, 2: 100, 3: 100, 4: 100, 5: 100, 6: 10, 7: 40, 8: 100}
"""Class -> side of its cubic bin."""

LARGEST = {6: 10, 7: 35, 8: 100}
"""Class -> largest side of an item, for the classes with one kind of item."""

MODULUS = 2**48


class Rand48:
    """lrand48 of the C library, seeded with srand48."""

    def __init__(self, seed: int) -> None:
        self.state = ((seed << 16) + 0x330E) % MODULUS

    def next(self) -> int:
        """The next number, 0 to 2^31 - 1."""
        self.state = (0x5DEECE66D * self.state + 0xB) % MODULUS
        return self.state >> 17

    def between(self, low: int, high: int) -> int:
        """A number from low to high, both included."""
        return low + self.next() % (high - low + 1)


def mpv(kind: int, n: int, number: int) -> Job:
    """One instance of a class; width, height and depth of the paper are x, y and z.

    Args:
        kind: the class, 1-8.
        n: number of items; the paper has 50, 100, 150 and 200.
        number: which of the class and n; the paper has 1-10.

    Raises:
        UserError: there is no such class, or no item.
    """
    if kind not in SIDES or n < 1:
        raise UserError(f"class {kind} with {n} items: give a class from 1 to 8 and an item")
    random, side = Rand48(n + number), SIDES[kind]
    items = tuple(ItemType(_size(random, kind, side)) for _ in range(n))
    return Job(items, (BinType((side, side, side)),), name=f"mpv-{kind}-{n}-{number}")


def _size(random: Rand48, kind: int, side: int) -> tuple[int, int, int]:
    if kind in LARGEST:
        ranges = [(1, LARGEST[kind])] * 3
    else:
        drawn = random.between(1, 10)
        shape = drawn if drawn <= 5 else kind  # 6 of 10 items, on average, are of the class's own
        small, large, half = (1, side // 2), (2 * side // 3, side), (side // 2, side)
        if shape <= 3:
            ranges = [small if axis == shape - 1 else large for axis in range(3)]
        else:
            ranges = [half if shape == 4 else small] * 3
    x, y, z = (random.between(low, high) for low, high in ranges)
    return x, y, z
