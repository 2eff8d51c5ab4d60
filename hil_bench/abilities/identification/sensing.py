"""The response of sensors that are behind: a first-order lag, then a delay."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]


class Sensors(NamedTuple):
    """The lag and the delay of each sensor [s]."""

    position_delay: float = 0.0
    position_lag: float = 0.0
    pressure_delay: float = 0.0
    pressure_lag: float = 0.0


_PROMPT = 1e-3  # of an interval: a lag below is none


def sense(motion: Values, interval: float, sensors: Sensors, every: int) -> Values:
    """Return the sensors' values in pieces of motion.

    What lies before a piece goes on from its start as it begins there.

    Args:
        motion: position [m], P_A and P_B [Pa] at the start and after each interval, shape
            (pieces, intervals + 1, 3).
        interval: between two of them [s].
        sensors: how far they are behind.
        every: intervals between two rows of the result.

    Returns:
        The signals after each `every`-th interval, shape (pieces, intervals // every, 3).
    """
    intervals = motion.shape[1] - 1
    times = np.arange(every, intervals + 1, every, dtype=np.float64)
    shown = np.empty((len(motion), len(times), 3))
    pairs = (
        (slice(0, 1), sensors.position_delay, sensors.position_lag),
        (slice(1, 3), sensors.pressure_delay, sensors.pressure_lag),
    )
    for signals, delay, lag in pairs:
        lagged = _lag(motion[:, :, signals], lag / interval)
        shown[:, :, signals] = _at(lagged, times - delay / interval)
    return shown


def _lag(values: Values, lag: float) -> Values:
    """Return values behind a first-order lag, exact for values that are straight in between.

    The lag begins as if the values had always risen as they first do.

    Args:
        values: shape (pieces, intervals + 1, signals).
        lag: time constant in intervals.
    """
    from scipy.signal import lfilter  # noqa: PLC0415 - an extra

    if lag < _PROMPT:
        return values
    fade = np.exp(-1.0 / lag)
    share = lag * (1.0 - fade)
    first = values[:, 1] - values[:, 0]
    begin = values[:, 0] - lag * first
    # y_k+1 = fade y_k + (share - fade) x_k + (1 - share) x_k+1
    state = fade * begin + (share - fade) * values[:, 0]
    coefficients = ([1.0 - share, share - fade], [1.0, -fade])
    rest, _ = lfilter(*coefficients, values[:, 1:], axis=1, zi=state[:, np.newaxis])
    return np.concatenate([begin[:, np.newaxis], rest], axis=1)


def _at(values: Values, places: Values) -> Values:
    """Return values at places between them, straight in between and beyond the ends."""
    last = values.shape[1] - 2
    index = np.clip(np.floor(places).astype(np.int64), 0, last)
    share = (places - index)[:, np.newaxis]
    return np.asarray((1.0 - share) * values[:, index] + share * values[:, index + 1])
