"""The set-points of a run as a course of few points, straight between."""

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_STRAIGHT = 1e-9  # of the full opening
_DIGITS = 6


def shorten_course(setpoints: Values, interval: float) -> list[tuple[float, float]]:
    """Return times [s] and values that lead through all set-points on straight lines.

    Args:
        setpoints: of each row, shape (rows,).
        interval: between two rows [s].
    """
    bends = np.abs(np.diff(setpoints, n=2)) > _STRAIGHT
    kept = np.flatnonzero(np.concatenate([[True], bends, [True]]))
    return [
        (round(row * interval, 9), round(float(setpoints[row]), _DIGITS)) for row in kept.tolist()
    ]
