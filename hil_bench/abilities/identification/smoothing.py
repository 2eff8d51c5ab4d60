"""The states of a record by Savitzky-Golay filters: where the pieces' starts begin."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

Values = npt.NDArray[np.float64]


LOOSENESS = 100.0
"""Times what noise alone leaves: smoothing errs by far more where the signals bend."""

_LATE = 0.01  # [s], that a sensor may be behind
_VAGUE = 1e6  # [Pa], of a pressure that follows from the other one and the motion


def smooth_states(
    record: AxisRecord,
    known: PlantParameters,
    *,
    is_behind: bool = False,
    load: Callable[[float], float] = lambda _: 0.0,
) -> tuple[Values, Values]:
    """Return position, velocity and both pressures of each row by Savitzky-Golay filters.

    A pressure that was not recorded follows from the other one by the balance of forces, eq. (12),
    with the configured mass and friction.

    Args:
        record: the measurement.
        known: areas, mass and friction.
        is_behind: whether the sensors are, so that they show states of a while ago.
        load: on the rod at a position [m], in [N].

    Returns:
        States, shape (rows, 4) [m, m/s, Pa, Pa], and how uncertain they are, of the same shape.
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
            values = np.nan_to_num(record.measured[part, signal])
            states[part, state] = savgol_filter(values, **how)
    noise = [record.noise[signal] * np.linalg.norm(savgol_coeffs(**how)) for signal, how in filters]
    spreads = np.tile(LOOSENESS * np.array(noise), (len(record), 1))
    if is_behind:
        for state, late in (
            (0, states[:, 1]),
            *((k, _slope(record, states[:, k])) for k in (2, 3)),
        ):
            spreads[:, state] += _LATE * np.abs(late)
    lacking = ~record.has_at(np.arange(len(record)))[:, 1:]
    if lacking.any():
        force = _force(record, states[:, 1], known) + np.array([*map(load, states[:, 0])])
        P_A, P_B = states[:, 2].copy(), states[:, 3].copy()  # noqa: N806 - the paper's symbols
        from_other = np.column_stack(
            [(known.A_B * P_B + force) / known.A_A, (known.A_A * P_A - force) / known.A_B]
        )
        states[:, 2:] = np.where(lacking, np.clip(from_other, known.P_T, known.P_S), states[:, 2:])
        spreads[:, 2:] = np.where(lacking, _VAGUE, spreads[:, 2:])
    return states, spreads


def _slope(record: AxisRecord, values: Values) -> Values:
    slopes = np.zeros(len(record))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        slopes[part] = np.gradient(values[part], record.interval)
    return slopes


def _force(record: AxisRecord, velocity: Values, known: PlantParameters) -> Values:
    """Return the force of both pressures that the motion takes, shape (rows,) [N]."""
    from scipy.signal import savgol_filter  # noqa: PLC0415 - an extra

    force = np.zeros(len(record))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        v = velocity[part]
        rate = savgol_filter(v, window_length=7, polyorder=2, deriv=1, delta=record.interval)
        stribeck = (known.F_s - known.F_c) * np.exp(-((np.abs(v) / known.chi) ** known.delta))
        dry = np.tanh(v / known.chi) * (known.F_c + stribeck)
        force[part] = known.m * rate + dry + known.sigma * v
    return force
