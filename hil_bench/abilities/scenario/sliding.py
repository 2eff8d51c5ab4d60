"""Sliding minimum and maximum, and `until`, over whole arrays.

The extreme of a window is that of two shorter ones that overlap, so their length doubles with each
pass. A window of 2^k samples takes k passes; up to the length of a whole run that is faster than
the algorithm of van Herk, Gil and Werman with its running extremes, which numpy cannot vectorise.
"""

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def slide(extreme: np.ufunc, values: Floats, width: int) -> Floats:
    """Return the extreme of each whole window.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        values: shape (n,).
        width: of the window, in samples, 1 or more.

    Returns:
        Of shape (n - width + 1,), empty where no window is whole.
    """
    count = len(values) - width + 1
    if count <= 0:
        return values[:0]
    reach, found = 1, values
    while 2 * reach <= width:
        found = extreme(found[:-reach], found[reach:])
        reach *= 2
    return np.asarray(extreme(found[:count], found[width - reach : width - reach + count]))


def until(held: Floats, goal: Floats) -> Floats:
    """Return `u` with ``u[k] = max(goal[k], min(held[k], u[k + 1]))``, and -inf behind the end.

    Each step maps the later value by ``max(a, min(b, u))``, and so do steps in a row. The array is
    cut into rows: first the map of each row, then the value behind each row, then all values.
    """
    columns = math.isqrt(len(held)) + 1
    rows = -(-len(held) // columns)
    holds, goals = np.full((2, rows * columns), math.inf)
    holds[: len(held)] = held
    goals[:] = -math.inf
    goals[: len(goal)] = goal
    by_column = np.ascontiguousarray(holds.reshape(rows, columns).T)
    goal_by_column = np.ascontiguousarray(goals.reshape(rows, columns).T)
    low, high = np.full(rows, -math.inf), np.full(rows, math.inf)
    for bound, aim in zip(by_column[::-1], goal_by_column[::-1], strict=True):
        low = np.maximum(aim, np.minimum(bound, low))
        high = np.minimum(bound, high)
    later = np.empty(rows)
    value = -math.inf
    for row in range(rows - 1, -1, -1):
        later[row] = value
        value = max(low[row], min(high[row], value))
    found = np.empty((columns, rows))
    for column in range(columns - 1, -1, -1):
        later = np.maximum(goal_by_column[column], np.minimum(by_column[column], later))
        found[column] = later
    return np.ascontiguousarray(found.T).ravel()[: len(held)]
