"""Do the signs of the columns go together? What is open is found, with how sure that is.

Three facts of any axis decide. Gauge pressures are above zero in the mean. What accelerates the
piston is a pressure that rises in A or falls in B, eq. (12) of Ruderman 2017. And an axis follows
its valve: above the dead-zone, velocity has the set-point's sign.
"""

import math
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import PRESSURES, AxisRecord
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

Values = npt.NDArray[np.float64]

_BLOCK = 0.1  # [s]: the parts of a record that count as independent
_SURE = 4.0  # deviations of the mean over the blocks, from which on a sign counts as known
_WEAK = 0.01  # of the strongest block's: a block with less is noise
_LEAST_BLOCKS, _LEAST_ROWS = 5, 10
_EXACT = 0.01  # spread of the blocks, at least
_MOVING = 0.1  # of the largest speed
_SWIFT = 0.05  # [s]: what goes on within that accelerates the piston


def settle_signs(record: AxisRecord, unknown: AbstractSet[str]) -> AxisRecord:
    """Return a record of one recording with the polarities that were unknown, and notes on them.

    Args:
        record: with each signal as its column has it.
        unknown: the quantities whose polarity is open, of position, P_A, P_B and spool_setpoint.

    Raises:
        ConfigError: an open polarity cannot be decided, or a given one contradicts the motion.
    """
    notes: list[str] = []
    measured = record.measured.copy()
    for signal, name in enumerate(PRESSURES, start=1):
        if name in unknown and np.isfinite(measured[:, signal]).all():
            sign = math.copysign(1.0, float(measured[:, signal].mean()))
            measured[:, signal] *= sign
            notes.append(f"polarity of {name}: {sign:+.0f}, since gauge pressures are above zero")
    record = replace(record, measured=measured)
    record, own_notes = _settle_position(record, is_open="position" in unknown)
    notes += own_notes
    score = _score(record, _slope(record, 1), record.setpoints)
    if "spool_setpoint" in unknown:
        sign, note = _decide("spool_setpoint", score, "the piston follows the valve")
        record = replace(record, setpoints=sign * record.setpoints)
        notes.append(note)
    elif score < -_SURE:
        raise ConfigError(
            f"the piston retracts where spool_setpoint is above zero ({-score:.0f} standard "
            "deviations); turn the polarity of spool_setpoint or of position"
        )
    return replace(record, notes=(*record.notes, *notes))


def check_sides(record: AxisRecord, parameters: PlantParameters) -> None:
    """Refuse a record of one recording whose pressures are one column, or exchanged: they brake.

    Friction is against the motion, so both pressures together push where the piston goes, whatever
    load is constant.

    Raises:
        ConfigError: they are equal in each row, which two sensors never are; or they push the other
            way, and would not if they were exchanged.
    """
    if not record.sessions[0].has.all():
        return
    pressures, velocity = record.measured[:, 1:], _slope(record, 1)
    if (pressures[:, 0] == pressures[:, 1]).all():
        raise ConfigError("P_A and P_B are equal in each row; give the column of each, or only one")
    is_moving = np.abs(velocity) > _MOVING * np.abs(velocity).max()
    forces = pressures * parameters.A_A - pressures[:, ::-1] * parameters.A_B
    forces = np.where(is_moving[:, None], forces - forces[is_moving].mean(axis=0), 0.0)
    scores = [_score(record, velocity, force) for force in forces.T]
    if scores[0] < -2.0 * _SURE and scores[1] > 2.0 * _SURE:
        raise ConfigError(
            f"P_A and P_B brake the piston ({-scores[0]:.0f} standard deviations), and would push "
            "it if they were exchanged; exchange the columns of P_A and P_B"
        )


def _settle_position(record: AxisRecord, *, is_open: bool) -> tuple[AxisRecord, list[str]]:
    """Return the record whose position goes where its pressures push, and notes on it.

    Raises:
        ConfigError: the pressures contradict the polarity or each other.
    """
    acceleration = _swift(record, _slope(record, 2))
    scores = [
        side * _score(record, acceleration, _swift(record, record.measured[:, signal]))
        for signal, side in ((1, 1.0), (2, -1.0))
        if record.sessions[0].has[signal]
    ]
    least, most = min(scores), max(scores)
    if is_open:
        if least < 0.0 < most:
            raise ConfigError(
                "the polarity of position is not decidable, since P_A and P_B contradict each "
                "other; check that they are not one and the same sensor"
            )
        score = max(scores, key=abs)
        sign, note = _decide("position", score, "the pressures accelerate the piston")
        return replace(record, measured=record.measured * [sign, 1.0, 1.0]), [note]
    if most < -_SURE:
        raise ConfigError(
            "the piston accelerates against its pressures "
            f"({-most:.0f} standard deviations); turn the polarity of position, or exchange P_A "
            "and P_B"
        )
    return record, []


def _slope(record: AxisRecord, order: int) -> Values:
    """Return the velocity or acceleration over some rows, by the order of the derivative."""
    from scipy.signal import savgol_filter  # noqa: PLC0415 - an extra

    def slope(x: Values) -> Values:
        return np.asarray(savgol_filter(x, 11, 3, deriv=order, delta=record.interval))

    return _by_stretch(record, record.measured[:, 0], slope)


def _swift(record: AxisRecord, values: Values) -> Values:
    """Return a signal less its moving mean."""
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415 - an extra

    rows = max(_LEAST_ROWS, record.rows_in(_SWIFT))
    return _by_stretch(record, values, lambda part: part - uniform_filter1d(part, rows))


def _by_stretch(record: AxisRecord, values: Values, change: Callable[[Values], Values]) -> Values:
    """Return a signal that is changed stretch by stretch, zero between them."""
    changed = np.zeros(len(values))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        changed[part] = change(values[part])
    return changed


def _score(record: AxisRecord, one: Values, other: Values) -> float:
    """Return the common sign of two signals in standard deviations above chance.

    Each block of the record gives one number, their correlation about zero.
    """
    length = max(_LEAST_ROWS, record.rows_in(_BLOCK))
    pairs = [
        (one[start : start + length], other[start : start + length])
        for rows in record.stretches
        for start in range(rows.start, rows.stop - length, length)
    ]
    strong = [float(np.abs(pair[0]).max() * np.abs(pair[1]).max()) for pair in pairs]
    least = _WEAK * max(strong, default=0.0)
    found = np.array(
        [
            float(pair[0] @ pair[1] / np.linalg.norm(pair[0]) / np.linalg.norm(pair[1]))
            for pair, size in zip(pairs, strong, strict=True)
            if size > least
        ]
    )
    if len(found) < _LEAST_BLOCKS:
        return 0.0
    spread = max(float(np.std(found, ddof=1)), _EXACT)
    return float(found.mean() / spread * math.sqrt(len(found)))


def _decide(name: str, score: float, reason: str) -> tuple[float, str]:
    """Return a sign and a note on it.

    Raises:
        ConfigError: it may be chance.
    """
    if abs(score) < _SURE:
        raise ConfigError(
            f"the polarity of {name} is not decidable from this recording: the evidence is "
            f"{abs(score):.1f} standard deviations, {_SURE:g} are wanted; give polarity = 1 or -1"
        )
    sign = math.copysign(1.0, score)
    sure = f"({abs(score):.0f} standard deviations)"
    return sign, f"polarity of {name}: {sign:+.0f}, since {reason} {sure}"
