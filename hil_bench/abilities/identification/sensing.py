"""The response of sensors that are behind: a position that is late, pressures behind a lag."""

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_PROMPT = 1e-3  # of a row: a lag below it counts as nothing


def sense(motion: Values, delay: float, lag: float) -> Values:
    """Return the sensors' values along a motion that begins at rest.

    Args:
        motion: position [m], P_A and P_B [Pa] at the start and in each row, shape (rows + 1, 3).
        delay: of the position, in rows.
        lag: time constant of the first-order lag of the pressures, in rows; exact for pressures
            that are straight between two rows.

    Returns:
        The values in each row, shape (rows, 3).
    """
    places = np.arange(len(motion))
    shown = motion[1:].copy()
    shown[:, 0] = np.interp(places[1:] - delay, places, motion[:, 0])
    if lag > _PROMPT:
        from scipy.signal import lfilter  # noqa: PLC0415 - an extra

        fade = np.exp(-1.0 / lag)
        share = lag * (1.0 - fade)
        # y_k+1 = fade y_k + (share - fade) x_k + (1 - share) x_k+1
        coefficients = ([1.0 - share, share - fade], [1.0, -fade])
        state = share * motion[:1, 1:]
        shown[:, 1:], _ = lfilter(*coefficients, motion[1:, 1:], axis=0, zi=state)
    return shown
