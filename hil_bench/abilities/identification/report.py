"""An identification for people, for programs, and as a file that `bench.toml` takes."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.approach import Rival
from hil_bench.abilities.identification.choice import KEYS
from hil_bench.abilities.identification.identify import Estimate, Identification
from hil_bench.abilities.identification.record import PRESSURES, SIGNALS, AxisRecord, Session
from hil_bench.abilities.identification.unknowns import SENSING
from hil_bench.config.settings import Key
from hil_bench.units import BAR, MICROMETRE, MILLIMETRE

Values = npt.NDArray[np.float64]

_DISPLAY = (MICROMETRE, BAR, BAR)

EXPLAINED = 3.0
"""Multiple of its noise that no signal's residual may exceed, or the model misses something."""

SUSPECT = 1.5
"""Multiple of the noise above which residuals of the fit itself are not noise alone."""

MOST_OFFSET = 5e5
"""Error of a pressure sensor [Pa] that no sensor has: it stands for a wrong supply or load."""

_SHORT = 0.1  # deviations: less changes no interval that anybody reads
_ALIKE = 1.05  # times the residual: no worse
_HEAD = (
    f"{'parameter':32} {'estimate':>12} {'std dev':>10} {'95 % from':>12} {'to':>12} "
    f"{'configured':>12}"
)
_SHOWN = 3  # parameters of another start

_WOULD_TELL = {
    "w": "motion at several openings of the valve, clear of dead-zone and saturation",
    "beta": "slow ramps of the set-point through the dead-zone, both ways",
    "alpha": "set-points beyond the full opening of the orifice",
    "omega_0": "quick changes of the set-point, or the recorded spool position",
    "xi": "quick changes of the set-point, or the recorded spool position",
    "E": "quick changes of the set-point, with the pressures recorded",
    "F_c": "slow motion both ways",
    "F_s": "motion that starts from standstill, and velocities below the Stribeck velocity",
    "sigma": "motion at several velocities, high ones among them",
    "chi": "velocities below and about the Stribeck velocity",
    "C_L": "standstill under unequal pressures with the valve closed, or very slow motion",
    "m": "quick changes of the set-point, so that the piston accelerates",
    "P_S": "fast motion both ways, with the pressures recorded",
    "P_T": "fast motion both ways, with the pressures recorded",
    "h": "motion to an end stop",
    "gain": "motion at several openings of the valve",
    **dict.fromkeys(SENSING, "quick changes of the set-point"),
}


def summarise(found: Identification) -> str:
    """Return the result as people read it."""
    record = found.record
    spans = [sum(map(len, parts)) * record.interval for parts in (record.fitted, record.tried)]
    noise = ", ".join(
        f"{name} {unit.from_si(value):.3g} {unit.symbol}"
        for name, value, unit in zip(SIGNALS, record.noise, _DISPLAY, strict=True)
        if math.isfinite(value)
    )
    rows = f"a row each {record.interval * 1e3:.4g} ms"
    lines = [
        f"{record.axis}: {rows}, {spans[0]:.3g} s for the fit, {spans[1]:.3g} s for the trial",
        *_session_lines(record),
        *record.notes,
        f"noise: {noise}",
        f"residuals of the fit: {_list_signals(found.residual)} times the noise, in "
        f"{found.pieces} pieces" + _left_out(found),
        "",
        _HEAD,
        *(_line(estimate, found) for estimate in found.told),
    ]
    if found.not_told:
        lines += ["", "not identifiable from this recording, kept as configured:"]
        lines += [_vague_line(estimate) for estimate in found.not_told]
    return "\n".join([*lines, "", *_trial_lines(found), *_warnings(found)])


def to_json(found: Identification) -> dict[str, Any]:
    """Return the result for programs: in the keys and units of `bench.toml`."""
    trial = found.trial
    return {
        "axis": found.record.axis,
        "recordings": [
            {
                "name": session.name,
                "signals": [*_names(session)],
                "pressure_offsets_bar": [BAR.from_si(offset) for offset in offsets],
                "flow_factor": flow,
            }
            for session, offsets, flow in zip(
                found.record.sessions,
                found.offsets.tolist(),
                [1.0] * len(found.offsets) if found.flows is None else found.flows.tolist(),
                strict=True,
            )
        ],
        "notes": [*found.record.notes],
        "fit_residual": _by_signal(found.residual),
        "is_explained": is_explained(found),
        "is_converged": found.is_reached,
        "is_white": found.is_white,
        "other_starts": [
            {
                "residual": rival.residual,
                "apart_in_deviations": {
                    KEYS[name].name: apart for name, apart in rival.apart.items()
                },
            }
            for rival in found.rivals
        ],
        "pieces": found.pieces,
        "left_out": found.left_out,
        "parameters": {
            _key(estimate).name: _entry(estimate, found) for estimate in found.estimates
        },
        "correlations": found.correlations.tolist(),
        "noise": _by_signal(found.record.noise),
        "has_spool_position": found.record.spool is not None,
        "trial_residual": _by_signal(trial.residual),
    }


def to_toml(found: Identification, source: str) -> str:
    """Return the told parameters as a table of `bench.toml`.

    Args:
        found: the result.
        source: what was read, for the comment.
    """
    lines = [
        f"# Identified by hil-bench from {source!r}; standard deviations in the comments.",
        "# What the record does not identify is not here, and stays as it is in your file.",
        *_doubts(found),
        f"[plant.{found.record.axis}]",
    ]
    if {"alpha", "beta", "gain"} & {estimate.name for estimate in found.told}:
        full = MILLIMETRE.from_si(found.record.full_opening)
        lines[2:2] = [
            "# All lengths of the valve go by the full opening that the record's set-points meant.",
            f"# Keep that in the table of the valve's node: full_opening_mm = {full:.6g}",
        ]
    for name in ("w", "alpha", "beta"):
        if any(estimate.name == "gain" for estimate in found.told):
            key = KEYS[name]
            value = key.unit.from_si(getattr(found.parameters, name))
            lines.append(f"{key.name} = {value:.6g}  # by the command's gain")
    for estimate in found.told:
        key = _key(estimate)
        value, deviation = key.unit.from_si(estimate.value), key.unit.from_si(estimate.deviation)
        ends = (_digits(key.unit.from_si(end), deviation) for end in estimate.interval)
        mark = "# " if estimate.name == "gain" or estimate.name in SENSING else ""
        lines.append(
            f"{mark}{key.name} = {_digits(value, deviation)}  # +- {deviation:.2g}, "
            f"95 %: {' to '.join(ends)}"
        )
    return "\n".join(lines) + "\n"


def _doubts(found: Identification) -> list[str]:
    """Return the doubts that a reader of the file must know."""
    if is_explained(found):
        return []
    return ["# The model does NOT explain the record: do not use these values."]


def find_misses(found: Identification) -> list[str]:
    """Return each signal that the model misses, where and by how much.

    A signal that it has only with an impossible offset of its sensor is missed, too.
    """
    misses = []
    for place, residual in (("in the trial", found.trial.residual), ("in the fit", found.residual)):
        for name, unit, times, noise in zip(
            SIGNALS, _DISPLAY, residual, found.record.noise, strict=True
        ):
            if times > EXPLAINED:
                size = f"{unit.from_si(times * noise):.3g} {unit.symbol} rms"
                misses.append(f"{name} by {size}, {times:.3g} times its noise, {place}")
    for session, offsets in zip(found.record.sessions, found.offsets, strict=True):
        misses += [
            f"{name}"
            + (f" in {session.name}" if session.name else "")
            + f", which fits only if its sensor reads {BAR.from_si(offset):+.1f} bar off"
            for name, offset, is_there in zip(PRESSURES, offsets, session.has[1:], strict=True)
            if is_there and abs(offset) > MOST_OFFSET
        ]
    return misses


def is_explained(found: Identification) -> bool:
    """Return True if the model follows every signal, where it was fitted and where it was tried."""
    return not find_misses(found)


def _line(estimate: Estimate, found: Identification) -> str:
    key = _key(estimate)
    deviation = key.unit.from_si(estimate.deviation)
    value, low, high = (
        _digits(key.unit.from_si(number), deviation)
        for number in (estimate.value, *estimate.interval)
    )
    configured = key.unit.from_si(_configured(found, estimate.name))
    return f"{key.name:32} {value:>12} {deviation:>10.2g} {low:>12} {high:>12} {configured:>12.6g}"


def _vague_line(estimate: Estimate) -> str:
    unit = _key(estimate).unit
    return (
        f"{_key(estimate).name:32} it would be uncertain by {unit.from_si(estimate.deviation):.2g} "
        f"{unit.symbol}; wanted: {_WOULD_TELL[estimate.name]}"
    )


def _trial_lines(found: Identification) -> list[str]:
    record, trial = found.record, found.trial
    drift = np.concatenate([run.model - record.measured[run.rows] for run in trial.runs])
    residual = _list_signals(trial.residual)
    piece = trial.rows.shape[1] * record.interval
    longest = max(len(run.rows) for run in trial.runs) * record.interval
    error = MILLIMETRE.from_si(math.sqrt(float((drift[:, 0] ** 2).mean())))
    lines = [
        f"on the part not fitted, in pieces of {piece:.3g} s: {residual} times the noise",
        f"there, in runs of up to {longest:.3g} s: position {error:.3g} mm rms",
    ]
    lines += _flow_lines(found)
    for session, offsets, deviations in zip(
        record.sessions, found.offsets, found.offset_deviations, strict=True
    ):
        place = f" in {session.name}" if len(record.sessions) > 1 else ""
        lines += [
            f"{name} reads {BAR.from_si(offset):+.3f} +- {BAR.from_si(deviation):.3f} bar off"
            + place
            for name, offset, deviation in zip(PRESSURES, offsets, deviations, strict=True)
            if abs(offset) > EXPLAINED * deviation
        ]
    return lines


def _flow_lines(found: Identification) -> list[str]:
    """Compare the flow of each recording with that of the first, a line each."""
    if found.flows is None or found.flow_deviations is None:
        return []
    first, *others = found.record.sessions
    return [
        f"{session.name}: the valve passes {factor:.4f} +- {deviation:.2g} of what it passes in "
        f"{first.name}"
        for session, factor, deviation in zip(
            others, found.flows[1:], found.flow_deviations[1:], strict=True
        )
    ]


def _warnings(found: Identification) -> list[str]:
    """Return the warnings that the user must know before using the result."""
    lines = []
    if not found.is_reached and found.decrement <= _SHORT:
        lines.append(
            f"the fit ended {found.decrement:.1g} standard deviations short of its optimum, "
            "because the cost jumps there; that is little beside the intervals"
        )
    elif not found.is_reached:
        lines.append(
            "the fit did NOT reach its optimum: do not rely on the intervals; "
            "try more --starts or another recording"
        )
    lines += [_rival_line(rival, found) for rival in found.rivals]
    misses = find_misses(found)
    if np.nanmax(found.residual) > SUSPECT and not misses:
        lines.append(
            f"the fit's own residuals are above {SUSPECT:g} times the noise: either the model "
            "lacks something, or the fit ended in a side minimum; the intervals do not hold then; "
            "try more --starts"
        )
    if not found.is_white and not misses:
        lines.append(
            "the residuals of the fit are not white noise: the intervals come from leaving out "
            "pieces of the record, and do not cover a model error that all pieces share"
        )
    if not found.record.moves_both_ways:
        lines.append(
            "the piston moves one way only, where friction looks like an error of the pressure "
            "sensors: both are known only as far as the sensors are right within 1 bar; move it "
            "both ways"
        )
    if misses:
        lines += [
            "the model does NOT explain this record, do not use the parameters: it misses",
            *(f"  {miss}" for miss in misses),
            *_advice(found),
        ]
    return lines


def _advice(found: Identification) -> list[str]:
    """Return the advice for a model that does not explain the record."""
    right = (
        f"at most {EXPLAINED:g} times the noise is right; check stroke, areas, volumes, supply "
        "pressure and the axis' options"
    )
    lines = [right]
    offsets = found.offsets[np.array([session.has[1:] for session in found.record.sessions])]
    if (offsets > MOST_OFFSET).all() or (offsets < -MOST_OFFSET).all():
        supply = BAR.from_si(found.parameters.P_S + 2.0 * float(offsets.mean()))
        lines.append(
            f"all pressures are off by about the same, as with a supply of {supply:.3g} bar; "
            "--free supply_pressure_bar estimates it"
        )
    if len(found.record.sessions) > 1 and found.flows is None:
        lines.append(
            "if the machine drifts from recording to recording: --free session_flow estimates that"
        )
    return lines


def _rival_line(rival: Rival, found: Identification) -> str:
    apart = sorted(rival.apart.items(), key=lambda item: -item[1])
    parameters = ", ".join(f"{KEYS[name].name} by {size:.3g}" for name, size in apart[:_SHOWN])
    residual = float(np.sqrt(np.nanmean(np.square(found.residual))))
    verdict = (
        "the recording fits both about equally well: do not rely on the intervals"
        if rival.residual < _ALIKE * residual
        else "it fits worse, so it is a side minimum"
    )
    return (
        f"another start ended elsewhere, with residuals of {rival.residual:.3g} times the noise "
        f"({residual:.3g} here): {parameters} standard deviations away; {verdict}"
    )


def _left_out(found: Identification) -> str:
    if not found.left_out:
        return ""
    return f"; {found.left_out} left out, which the model does not explain or only by chance"


def _session_lines(record: AxisRecord) -> list[str]:
    """List each recording's signals, where there are several or where a pressure is missing."""
    if len(record.sessions) == 1 and record.has.all():
        return []
    return [
        f"{session.name}: {len(session.rows) * record.interval:.3g} s, {', '.join(_names(session))}"
        for session in record.sessions
    ]


def _names(session: Session) -> list[str]:
    return [name for name, is_there in zip(SIGNALS, session.has, strict=True) if is_there]


def _by_signal(values: Values) -> dict[str, float | None]:
    """Return a value by signal, None where no recording has the signal."""
    pairs = zip(SIGNALS, values.tolist(), strict=True)
    return {name: value if math.isfinite(value) else None for name, value in pairs}


def _list_signals(residual: Values) -> str:
    return ", ".join(
        f"{name} {value:.2f}"
        for name, value in zip(SIGNALS, residual, strict=True)
        if math.isfinite(value)
    )


def _entry(estimate: Estimate, found: Identification) -> dict[str, Any]:
    unit = _key(estimate).unit
    return {
        "is_told": estimate.is_told,
        "value": unit.from_si(estimate.value),
        "standard_deviation": unit.from_si(estimate.deviation),
        "interval_95": [unit.from_si(end) for end in estimate.interval],
        "configured": unit.from_si(_configured(found, estimate.name)),
        "unit": unit.symbol,
    }


def _configured(found: Identification, name: str) -> float:
    """Return the configured value of an unknown [SI]."""
    if name == "gain":
        return 1.0
    return float(getattr(found.sensors if name in SENSING else found.known, name))


def _key(estimate: Estimate) -> Key:
    return KEYS[estimate.name]


def _digits(value: float, deviation: float) -> str:
    """Return a value with two uncertain digits."""
    if not value or not deviation:
        return f"{value:.6g}"
    decimals = 1 - math.floor(math.log10(deviation))
    if decimals > 12:
        return f"{value:.6g}"
    return f"{value:.{max(decimals, 1)}f}"
