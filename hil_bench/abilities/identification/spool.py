"""The spool by its recorded set-points: eq. (3) exactly, and its fit to a recorded position."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import AxisRecord, estimate_noise
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.spool import spool_transition

Values = npt.NDArray[np.float64]

_FLOOR = 1e-7  # [m]


def recorded_spool(parameters: PlantParameters, record: AxisRecord) -> Values:
    """Return spool position [m] and velocity [m/s] at each row of a record, shape (rows, 2).

    Between the stretches of the record there is nothing, and so zeros.
    """
    states = np.zeros((len(record), 2))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        states[part] = spool_states(parameters, record.setpoints[part], record.interval)
    return states


def spool_states(parameters: PlantParameters, setpoints: Values, interval: float) -> Values:
    """Return spool position [m] and velocity [m/s] at the end of each interval, shape (rows, 2).

    The spool starts at rest at the first set-point.

    Args:
        parameters: of the plant.
        setpoints: u [m] of each interval, shape (rows,).
        interval: between two rows [s].
    """
    from scipy.signal import lfilter  # noqa: PLC0415 - an extra

    a_11, a_12, a_21, a_22 = spool_transition(parameters.omega_0, parameters.xi, interval)
    trace, determinant = a_11 + a_22, a_11 * a_22 - a_12 * a_21
    # The transition s' = A (s - e u) + e u with e = (1, 0), as a transfer function of u.
    denominator = [1.0, -trace, determinant]
    position = [1.0 - a_11, determinant - a_22]
    velocity = [-a_21, a_21]
    change = setpoints - setpoints[0]
    return np.column_stack(
        [
            lfilter(position, denominator, change) + setpoints[0],
            lfilter(velocity, denominator, change),
        ]
    )


def fit_spool(record: AxisRecord, known: PlantParameters) -> dict[str, tuple[float, float]]:
    """Return omega_0 and xi with their standard deviations, from the recorded spool position.

    Nothing where it was not recorded, or does not tell both within 10 %.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - an extra

    if record.spool is None:
        return {}
    rows = np.concatenate([[*part] for part in record.fitted])
    rows = rows[np.isfinite(record.spool[rows])]
    spool = record.spool[rows]
    noise = estimate_noise(record.spool[np.isfinite(record.spool)], _FLOOR)

    def residuals(logs: Values) -> Values:
        states = recorded_spool(_scaled(known, logs), record)
        return np.asarray((states[rows, 0] - spool) / noise)

    found = least_squares(
        residuals, np.zeros(2), bounds=(-2.0, 2.0), loss="soft_l1", diff_step=1e-4
    )
    variance = max(1.0, 2.0 * found.cost / len(spool))
    deviations = np.sqrt(variance * np.diag(np.linalg.pinv(found.jac.T @ found.jac)))
    is_told = bool((deviations < 0.1).all() and np.linalg.matrix_rank(found.jac) == 2)
    values = _scaled(known, found.x)
    if not is_told:
        return {}
    return {
        name: (getattr(values, name), getattr(values, name) * float(deviation))
        for name, deviation in zip(("omega_0", "xi"), deviations, strict=True)
    }


def _scaled(known: PlantParameters, logs: Values) -> PlantParameters:
    omega_0, xi = np.exp(logs).tolist()
    return replace(known, omega_0=known.omega_0 * omega_0, xi=known.xi * xi)
