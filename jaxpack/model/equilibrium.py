"""Forces that hold a stack of boxes, as a linear program."""

import numpy as np

SLACK = 1e-7  # of a stack's weight times a box's side: moments that the solver may leave


def lacking_moments(
    upper: np.ndarray,
    lower: np.ndarray,
    contacts: np.ndarray,
    middle: np.ndarray,
    weight: np.ndarray,
) -> np.ndarray:
    """The moments about the centres along x and y that k boxes lack at least: float [2, k].

    Forces of at least 0 press upwards on the upper and downwards on the lower box at the corners of
    every contact. Moments are shares of the weight of all boxes times the box's own side. Where
    they come to less than `SLACK`, there are none.

    Args:
        upper: int [p], the box that lies on another; every box does.
        lower: int [p], the box below; -1 is ground that gives way nowhere.
        contacts: float [2, p, 2], the low and the high ends of the rectangles in which they touch.
        middle: float [2, k, 2], the centres and the sides of the boxes.
        weight: float [k], at least 0.

    Raises:
        RuntimeError: the solver gave up.
    """
    from scipy.optimize import linprog
    from scipy.sparse import coo_array, eye_array, hstack

    count, none = len(weight), np.zeros((2, len(weight)))
    if not weight.any():
        return none
    x, y = contacts[[0, 0, 1, 1], :, 0], contacts[[0, 1, 0, 1], :, 1]
    points = np.stack([x.ravel(), y.ravel()], 1)
    force = np.arange(len(points))
    inner = np.flatnonzero(np.tile(lower >= 0, 4))
    entries = []
    for sign, box, on in ((1, np.tile(upper, 4), force), (-1, np.tile(lower, 4)[inner], inner)):
        lever = (points[on] - middle[0, box]) / middle[1, box]
        for part, values in enumerate((np.ones(len(on)), *lever.T)):
            entries.append((sign * values, part * count + box, on))
    values, row, column = np.hstack(entries)
    ends = row.astype(int), column.astype(int)
    balance = coo_array((values, ends), (3 * count, len(force))).tocsc()
    load = np.append(weight / weight.sum(), none)
    options = {"primal_feasibility_tolerance": SLACK / 100}
    if linprog(0 * force, A_eq=balance, b_eq=load, options=options).status == 0:
        return none  # sooner known than the least that is lacking
    moment = eye_array(3 * count).tocsc()[:, count:]
    cost = np.repeat([0.0, 1.0], [len(force), 4 * count])
    found = linprog(cost, A_eq=hstack([balance, moment, -moment]), b_eq=load, options=options)
    if found.status:
        raise RuntimeError(f"the equilibrium of {count} items: {found.message}")
    lacking: np.ndarray = found.x[len(force) :].reshape(2, 2, count).sum(0)
    return lacking if lacking.sum() > SLACK else none
