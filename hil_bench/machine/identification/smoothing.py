"""The states of a record by Savitzky-Golay filters: where the pieces' starts begin."""

from typing import Any

import numpy as np
import numpy.typing as npt

from hil_bench.machine.identification.record import AxisRecord

Values = npt.NDArray[np.float64]


def smooth_states(record: AxisRecord) -> tuple[Values, Values]:
    """Return position, velocity and both pressures of each row by Savitzky-Golay filters.

    Returns:
        States, shape (rows, 4) [m, m/s, Pa, Pa], and what noise alone leaves on them, shape (4,).
    """
    from scipy.signal import savgol_coeffs, savgol_filter  # noqa: PLC0415 - an extra

    slope = {"deriv": 1, "delta": record.interval}
    filters: list[tuple[int, dict[str, Any]]] = [
        (0, {"window_length": 7, "polyorder": 3}),
        (0, {"window_length": 7, "polyorder": 3, **slope}),
        (1, {"window_length": 5, "polyorder": 2}),
        (2, {"window_length": 5, "polyorder": 2}),
    ]
    states = np.zeros((len(record), 4))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        for state, (signal, how) in enumerate(filters):
            states[part, state] = savgol_filter(record.measured[part, signal], **how)
    noise = [record.noise[signal] * np.linalg.norm(savgol_coeffs(**how)) for signal, how in filters]
    return states, np.array(noise)
