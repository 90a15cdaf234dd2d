"""Pairs of rows of which one exceeds the other in every column, found without comparing them all.

That two boxes overlap, that one lies over the other, that one was loaded earlier: all of it is
"less in every column". The rows are the leaves of a tree whose nodes hold the largest of what is
below them in every column, so that most pairs are ruled out many at a time.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

FAN = 8  # children of a node
TOP = 64  # nodes of the last level at most: so few are soon compared with
BLOCK = 1 << 16  # pairs compared at a time: bounds the memory
_NOTHING = np.iinfo(np.int32).min  # fills up a node: exceeds nothing


class Tree(NamedTuple):
    """Rows to be found."""

    order: np.ndarray  # [n], which row each leaf is
    levels: tuple[np.ndarray, ...]  # int32 [k, nodes], leaves first; the last has few nodes


def tree_of(given: np.ndarray, order: np.ndarray) -> Tree:
    """A tree over rows.

    Args:
        given: int32 [k, n], the columns of n rows, at least one.
        order: [n], the rows such that neighbours are alike; any permutation is right.
    """
    levels = [given[:, order]]
    while (count := levels[-1].shape[1]) > TOP:
        levels[-1] = np.pad(levels[-1], ((0, 0), (0, -count % FAN)), constant_values=_NOTHING)
        levels.append(levels[-1].reshape(len(given), -1, FAN).max(2))
    return Tree(order, tuple(levels))


def pairs(asked: np.ndarray, tree: Tree, first: int = 0) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """All (i, j) with asked[:, i] < given[:, j] in every column, in blocks ([p], [p]).

    The caller may raise `asked` between two blocks, and thereby end the search for a row. Pairs of
    a large given[first] come early, though not in order.

    Args:
        asked: int32 [k, m].
        tree: of `given`.
        first: a column.
    """
    top = tree.levels[-1].shape[1]
    for start in range(0, asked.shape[1], BLOCK // top):
        rows = np.arange(start, min(start + BLOCK // top, asked.shape[1]))
        stack = [(len(tree.levels) - 1, rows.repeat(top), np.tile(np.arange(top), len(rows)))]
        while stack:
            level, rows, nodes = stack.pop()
            for least, most in zip(asked, tree.levels[level], strict=True):
                kept = np.flatnonzero(least[rows] < most[nodes])
                rows, nodes = rows[kept], nodes[kept]
            if not len(rows):
                continue
            if level == 0:
                yield rows, tree.order[nodes]
                continue
            rows = np.repeat(rows, FAN)
            nodes = (nodes[:, None] * FAN + np.arange(FAN)).ravel()
            if len(rows) > BLOCK:
                promising = np.argsort(-tree.levels[level - 1][first, nodes], kind="stable")
                rows, nodes = rows[promising], nodes[promising]
            for last in range(len(rows) - 1 - (len(rows) - 1) % BLOCK, -1, -BLOCK):
                part = slice(last, last + BLOCK)
                stack.append((level - 1, rows[part], nodes[part]))


def best(asked: np.ndarray, tree: Tree, first: int) -> np.ndarray:
    """Of the j with asked[:, i] < given[:, j] the one with the largest given[first], for every i.

    Args:
        asked: int32 [k, m].
        tree: of `given`, whose column `first` has no value twice, or any of them will do.
        first: a column.

    Returns:
        [m]; -1 where there is none.
    """
    asked, given = asked.copy(), np.empty(len(tree.order), np.int32)
    given[tree.order] = tree.levels[0][first, : len(given)]
    found = np.full(asked.shape[1], -1)
    for rows, others in pairs(asked, tree, first):
        ascending = np.argsort(given[others], kind="stable")
        rows, others = rows[ascending], others[ascending]
        found[rows] = others  # of a row that is there several times the last one counts
        asked[first, rows] = given[others]
    return found
