"""An identification for people, for programs, and as a file that `bench.toml` takes."""

import math
from typing import Any

import numpy as np

from hil_bench.config.keys import PARAMETER_KEYS
from hil_bench.config.settings import Key
from hil_bench.identification.identify import Estimate, Identification
from hil_bench.identification.record import SIGNALS
from hil_bench.units import BAR, MICROMETRE, MILLIMETRE

_KEYS = {key.field: key for key in PARAMETER_KEYS}
_DISPLAY = (MICROMETRE, BAR, BAR)

EXPLAINED = 3.0
"""Multiple of the noise below which residuals mean that the model explains the record."""

SUSPECT = 1.5
"""Multiple of the noise above which residuals of the fit itself are not noise alone."""

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
}


def summarise(found: Identification) -> str:
    """Return the result as people read it."""
    record = found.record
    spans = [sum(map(len, parts)) * record.interval for parts in (record.fitted, record.tried)]
    noise = ", ".join(
        f"{name} {unit.from_si(value):.3g} {unit.symbol}"
        for name, value, unit in zip(SIGNALS, record.noise, _DISPLAY, strict=True)
    )
    rows = f"a row each {record.interval * 1e3:.4g} ms"
    lines = [
        f"{record.axis}: {rows}, {spans[0]:.3g} s for the fit, {spans[1]:.3g} s for the trial",
        f"noise: {noise}",
        f"residuals of the fit: {found.residual:.2f} times the noise, in {found.pieces} pieces"
        + (f"; {found.left_out} left out, which the model does not explain" * bool(found.left_out)),
        "",
        f"{'parameter':32} {'found':>12} {'std dev':>10} {'configured':>12}",
        *(_line(estimate, found) for estimate in found.told),
    ]
    if found.not_told:
        lines += ["", "not told by this record, so kept as configured:"]
        lines += [_vague_line(estimate) for estimate in found.not_told]
    return "\n".join([*lines, "", *_trial_lines(found)])


def to_json(found: Identification) -> dict[str, Any]:
    """Return the result for programs: in the keys and units of `bench.toml`."""
    trial = found.trial
    return {
        "axis": found.record.axis,
        "residual": found.residual,
        "is_explained": is_explained(found),
        "pieces": found.pieces,
        "left_out": found.left_out,
        "parameters": {
            _key(estimate).name: _entry(estimate, found) for estimate in found.estimates
        },
        "pressure_offsets_bar": [BAR.from_si(offset) for offset in found.offsets],
        "noise": dict(zip(SIGNALS, found.record.noise.tolist(), strict=True)),
        "trial_residual": dict(zip(SIGNALS, trial.residual.tolist(), strict=True)),
    }


def to_toml(found: Identification, source: str) -> str:
    """Return the told parameters as a table of `bench.toml`.

    Args:
        found: the result.
        source: what was read, for the comment.
    """
    lines = [
        f"# Identified by hil-bench from {source!r}; standard deviations in the comments.",
        "# What the record does not tell is not here, and stays as it is in your file.",
        f"[plant.{found.record.axis}]",
    ]
    if {"alpha", "beta"} & {estimate.name for estimate in found.told}:
        full = MILLIMETRE.from_si(found.record.full_opening)
        lines[2:2] = [
            "# All lengths of the valve go by the full opening that the record's set-points meant.",
            f"# Keep that in the table of the valve's node: full_opening_mm = {full:.6g}",
        ]
    for estimate in found.told:
        key = _key(estimate)
        value, deviation = key.unit.from_si(estimate.value), key.unit.from_si(estimate.deviation)
        lines.append(f"{key.name} = {_digits(value, deviation)}  # +- {deviation:.2g}")
    return "\n".join(lines) + "\n"


def is_explained(found: Identification) -> bool:
    """Return whether the model follows the position where it was tried."""
    return bool(found.trial.residual[0] <= EXPLAINED)


def _line(estimate: Estimate, found: Identification) -> str:
    key = _key(estimate)
    value, deviation = key.unit.from_si(estimate.value), key.unit.from_si(estimate.deviation)
    configured = key.unit.from_si(getattr(found.known, estimate.name))
    return f"{key.name:32} {_digits(value, deviation):>12} {deviation:>10.2g} {configured:>12.6g}"


def _vague_line(estimate: Estimate) -> str:
    unit = _key(estimate).unit
    return (
        f"{_key(estimate).name:32} it would be uncertain by {unit.from_si(estimate.deviation):.2g} "
        f"{unit.symbol}; wanted: {_WOULD_TELL[estimate.name]}"
    )


def _trial_lines(found: Identification) -> list[str]:
    record, trial = found.record, found.trial
    residual = ", ".join(
        f"{name} {value:.2f}" for name, value in zip(SIGNALS, trial.residual, strict=True)
    )
    drift = np.concatenate([run.model - record.measured[run.rows] for run in trial.runs])
    piece = trial.rows.shape[1] * record.interval
    longest = max(len(run.rows) for run in trial.runs) * record.interval
    error = MILLIMETRE.from_si(math.sqrt(float((drift[:, 0] ** 2).mean())))
    lines = [
        f"on the part not fitted, in pieces of {piece:.3g} s: {residual} times the noise",
        f"there, in runs of up to {longest:.3g} s: position {error:.3g} mm rms",
    ]
    offsets = zip(("P_A", "P_B"), found.offsets, found.offset_deviations, strict=True)
    lines += [
        f"{name} reads {BAR.from_si(offset):+.3f} +- {BAR.from_si(deviation):.3f} bar off"
        for name, offset, deviation in offsets
        if abs(offset) > EXPLAINED * deviation
    ]
    if found.residual > SUSPECT:
        lines.append(
            f"the fit's own residuals are above {SUSPECT:g} times the noise: either the model "
            "lacks something, or the fit ended in a side minimum; deviations do not hold then; "
            "try more --starts"
        )
    if not record.moves_both_ways:
        lines.append(
            "the piston moves one way only, where friction looks like an error of the pressure "
            "sensors: both are told only as far as the sensors are right within 1 bar; move it "
            "both ways"
        )
    if not is_explained(found):
        lines.append(
            f"the model does NOT explain this record: {EXPLAINED:g} times the noise at most would "
            "be right; check stroke, areas, volumes, supply pressure and the axis' options"
        )
    return lines


def _entry(estimate: Estimate, found: Identification) -> dict[str, Any]:
    unit = _key(estimate).unit
    return {
        "is_told": estimate.is_told,
        "value": unit.from_si(estimate.value),
        "standard_deviation": unit.from_si(estimate.deviation),
        "configured": unit.from_si(getattr(found.known, estimate.name)),
        "unit": unit.symbol,
    }


def _key(estimate: Estimate) -> Key:
    return _KEYS[estimate.name]


def _digits(value: float, deviation: float) -> str:
    """Return a value with two uncertain digits."""
    if not value or not deviation:
        return f"{value:.6g}"
    decimals = 1 - math.floor(math.log10(deviation))
    if decimals > 12:
        return f"{value:.6g}"
    return f"{value:.{max(decimals, 1)}f}"
