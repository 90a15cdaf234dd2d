"""The rules of loads once more, item by item and without anything clever.

For whole numbers in 3D. Gives the set of (rule, bin, turn) of items, (rule, bin) of bins.
"""

from functools import cache
from itertools import product

from jaxpack.model.box_check import Rule


def overlap(one, other, axes):
    return all(one[0][a] < other[1][a] and other[0][a] < one[1][a] for a in axes)


def plain_rules(job, plan, gap=0, door="", balance=None, heavy_below=False):
    return {
        (rule, number, *turn)
        for number, packed in enumerate(plan.bins)
        for rule, *turn in _of_bin(job, packed, gap, door, balance, heavy_below)
    }


def _of_bin(job, packed, gap, door, balance, heavy_below):
    boxes, items = [], []
    for put in packed.placements:
        size = job.items[put.item].turned(put.orientation)
        boxes.append((put.corner, tuple(map(sum, zip(put.corner, size, strict=True)))))
        items.append(job.items[put.item])
    solid = [(one.corner, one.end) for one in job.bins[packed.bin].limits.obstacles]
    count = len(boxes)
    boxes += solid

    def area(one, other):
        (a, b), (c, d) = boxes[one], boxes[other]
        x, y = (min(b[axis], d[axis]) - max(a[axis], c[axis]) for axis in (0, 1))
        return x * y

    under = {
        i: [
            j
            for j in range(len(boxes))
            if boxes[j][1][2] == boxes[i][0][2] and overlap(boxes[i], boxes[j], (0, 1))
        ]
        for i in range(count)
    }
    over = {j: [i for i in range(count) if j in under[i]] for j in range(count)}

    @cache
    def load(j):
        return sum(
            (items[i].weight + load(i)) * area(i, j) / sum(area(i, k) for k in under[i])
            for i in over[j]
        )

    @cache
    def below(i):
        return 1 + max((below(j) for j in under[i] if j < count), default=0)

    @cache
    def above(j):
        return 1 + max(map(above, over[j]), default=0)

    stop = [item.limits.stop or 10**9 for item in items]
    for i, item in enumerate(items):
        limits, box = item.limits, boxes[i]
        lies_on = [j for j in under[i] if j < count]
        checks = {
            Rule.ON_FLOOR: limits.floor and box[0][2] != 0,
            Rule.STACKABLE: any(not items[j].limits.stackable for j in lies_on),
            Rule.STACK_ID: any(items[j].limits.stack_id != limits.stack_id for j in lies_on),
            Rule.HEAVY_BELOW: heavy_below and any(items[j].weight < item.weight for j in lies_on),
            Rule.STACK: below(i) + above(i) - 1 > (limits.most_in_stack or 10**9),
            Rule.WEIGHT_ABOVE: load(i) > limits.weight_above * (1 + 1e-9),
            Rule.STOP: any(
                stop[j] > stop[i]
                and (
                    (overlap(box, boxes[j], (0, 1)) and boxes[j][0][2] >= box[1][2])
                    or (door and overlap(box, boxes[j], (1, 2)) and boxes[j][0][0] >= box[1][0])
                )
                for j in range(count)
            ),
            Rule.APART: any(
                limits.apart and items[j].limits.apart == limits.apart for j in range(i)
            ),
        }
        near = [
            j
            for j in range(i)
            if overlap(box, boxes[j], (2,))
            and all(
                box[0][a] < boxes[j][1][a] + gap and boxes[j][0][a] < box[1][a] + gap
                for a in (0, 1)
            )
        ]
        checks[Rule.GAP] = bool(gap and near and not overlap(box, boxes[near[0]], (0, 1, 2)))
        yield from ((rule, i) for rule, found in checks.items() if found)
    most = job.bins[packed.bin].limits.most_items
    if most is not None and count > most:
        yield (Rule.ITEMS,)
    if balance is not None:
        masses = [item.weight for item in items]
        if not any(item.weight for item in job.items):
            masses = [item.size[0] * item.size[1] * item.size[2] for item in items]
        for axis, side in zip((0, 1), job.bins[packed.bin].size, strict=False):
            centre = sum(
                m * (b[0][axis] + b[1][axis]) / 2 for m, b in zip(masses, boxes, strict=False)
            )
            if sum(masses) and abs(centre / sum(masses) - side / 2) > balance * side / 2 + 1e-12:
                yield (Rule.BALANCE,)


def heap(random, count, side, most):
    """Corners and sizes of items in a heap, each on what is below it: valid but for support."""
    tops = [[0] * side for _ in range(side)]
    for _ in range(count):
        size = [int(n) for n in random.integers(1, most + 1, 3)]
        x, y = (int(random.integers(0, side - size[a] + 1)) for a in (0, 1))
        cells = list(product(range(x, x + size[0]), range(y, y + size[1])))
        z = max(tops[a][b] for a, b in cells)
        for a, b in cells:
            tops[a][b] = z + size[2]
        yield (x, y, z), tuple(size)
