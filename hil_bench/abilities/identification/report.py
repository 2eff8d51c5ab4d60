"""An identification for people and for programs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hil_bench.abilities.identification.errors import (
    BEYOND,
    QUANTITIES,
    Limit,
    StrokeError,
    describe_errors,
    find_exceeded,
    stated_error,
)
from hil_bench.abilities.identification.identify import Estimate, Identification
from hil_bench.abilities.identification.machine import UNITS
from hil_bench.abilities.identification.record import SIGNALS
from hil_bench.abilities.identification.strokes import Stroke
from hil_bench.units import BAR, MILLIMETRE

_DISPLAY = (MILLIMETRE, BAR, BAR)
_FULL = 0.95  # of the opening
_HEAD = (
    f"{'parameter':32} {'estimate':>12} {'std dev':>10} {'95 % from':>12} {'to':>12} {'before':>12}"
)


def summarise(found: Identification, limits: Sequence[Limit]) -> str:
    """Return the result as people read it."""
    record, course = found.record, found.bench.course
    strokes = course.strokes
    noise = ", ".join(
        f"{name} {unit.from_si(value):.2g} {unit.symbol}"
        for name, value, unit in zip(SIGNALS, record.noise, _DISPLAY, strict=True)
        if math.isfinite(value)
    )
    openings = sorted({round(100.0 * one.opening) for one in strokes})
    spread = f"{openings[0]} to {openings[-1]} %" if len(openings) > 1 else f"{openings[0]} %"
    ways = sum(one.is_forth for one in strokes)
    lines = [
        f"{record.axis}: {len(strokes)} strokes, {ways} out, {len(strokes) - ways} in, at {spread}",
        *([f"{course.dropped} more strokes were left aside"] if course.dropped else []),
        *record.notes,
        f"noise: {noise}",
        "",
        *ladder_lines(found),
        "",
        *error_lines(found),
        "",
        _HEAD,
        *(estimate_line(one) for one in found.estimates if one.is_told),
    ]
    if vague := [one.name for one in found.estimates if not one.is_told]:
        lines += ["", f"not identifiable from this recording: {', '.join(vague)}"]
    return "\n".join([*lines, *_warnings(found, limits)])


def ladder_lines(found: Identification) -> list[str]:
    """Return the table of the models that were tried."""
    lines = [f"{'model':32} {'unknowns':>8} {'error':>7}  left-out strokes within"]
    for place, rung in enumerate(found.ladder.rungs):
        mark = "  <- taken" if place == found.ladder.chosen else ""
        text = describe_errors(rung.errors) or "not judged"
        lines.append(f"{rung.title:32} {len(rung.fit.unknowns):8} {rung.score:7.3f}  {text}{mark}")
    return lines


def error_lines(found: Identification) -> list[str]:
    """Return the errors of prediction as a user reads them."""
    if not (within := describe_errors(found.ladder.best.errors)):
        return ["errors of prediction: not known, because no stroke could be left out"]
    lines = [f"nine of ten strokes that were left out of the fit are predicted within {within}"]
    if found.largest_opening < _FULL:
        largest = f"{100.0 * found.largest_opening:.0f} % opening, the largest recorded"
        sets_in = "and on more where something sets in only there, such as a pump at its limit"
        lines += [f"beyond {largest}, count on {BEYOND:g} times as much,", sets_in]
    return [*lines, *found.ladder.notes]


def estimate_line(one: Estimate) -> str:
    """Return the line of an estimate."""
    value, low, high = (_digits(each, one.deviation) for each in (one.value, *one.interval))
    return (
        f"{one.name:32} {value:>12} {one.deviation:>10.2g} {low:>12} {high:>12} {one.start:>12.6g}"
    )


def _warnings(found: Identification, limits: Sequence[Limit]) -> list[str]:
    record, ladder = found.record, found.ladder
    lines = []
    if not (ladder.is_whole and found.is_refined):
        lines.append("the time was over: this is the best so far; --time-limit gives more")
    if not record.moves_both_ways:
        lines.append("the piston moves one way only; record strokes both ways")
    sizes = found.bench.misses(found.fit.values)
    missed = [signal for signal in range(3) if sizes[signal] > 3.0 * record.noise[signal]]
    lines += [_miss(found, signal, sizes[signal]) for signal in missed]
    lines += [f"NOT as required: {one}" for one in find_exceeded(ladder.best.errors, limits)]
    return ["", *lines] if lines else []


def _miss(found: Identification, signal: int, size: float) -> str:
    """Return a line on a signal that the model misses, with what that looks like."""
    unit, likeness = _DISPLAY[signal], _looks_like(found, signal)
    times = size / found.record.noise[signal]
    return (
        f"{SIGNALS[signal]} is off by {unit.from_si(size):.2g} {unit.symbol} rms, "
        f"{times:.2g} times its noise: the model lacks something; "
        f"the residual goes {likeness}"
    )


_SIGNS = (
    ("with the speed", "as with friction or valve flow of another course"),
    ("with the pressure", "as with leakage, air or a gain of the sensor"),
    ("with the acceleration", "as with another mass or a late sensor"),
    ("with time", "as with a drift of oil temperature or sensor"),
)


def _looks_like(found: Identification, signal: int) -> str:
    """Describe the course that the residual of a signal is most like."""
    strokes, interval = found.bench.course.strokes, found.record.interval

    def courses(stroke: Stroke) -> Any:  # noqa: ANN401 - an array
        rows = found.bench.measured(stroke)
        speed = np.gradient(rows[:, 0], interval)
        pressure = rows[:, 1] if np.isfinite(rows[:, 1]).all() else rows[:, 2]
        number = np.full(len(rows), float(stroke.number))
        return np.column_stack([speed, pressure, np.gradient(speed), number])

    every = np.concatenate(found.bench.deviations(found.fit.values))[:, signal]
    there = np.isfinite(every)
    table = np.concatenate([courses(one) for one in strokes])[there]
    with np.errstate(divide="ignore", invalid="ignore"):
        likeness = np.abs(np.nan_to_num(np.corrcoef(every[there], table.T)[0, 1:]))
    place = int(np.argmax(likeness))
    if likeness[place] < 0.2:
        return "with nothing that was looked at"
    return f"{_SIGNS[place][0]} ({likeness[place]:.2f}), {_SIGNS[place][1]}"


def to_json(found: Identification, limits: Sequence[Limit]) -> dict[str, Any]:
    """Return the result for programs, in the keys and units of `bench.toml`."""
    return {
        "axis": found.record.axis,
        "strokes": len(found.bench.course.strokes),
        "recordings": [session.name for session in found.record.sessions],
        "notes": [*found.record.notes, *found.ladder.notes],
        "is_whole": found.ladder.is_whole and found.is_refined,
        "models": [
            {
                "adds": rung.title,
                "unknowns": len(rung.fit.unknowns),
                "error": _finite(rung.score),
                "is_taken": place == found.ladder.chosen,
                "prediction": _stated(rung.errors),
            }
            for place, rung in enumerate(found.ladder.rungs)
        ],
        "prediction": _stated(found.ladder.best.errors),
        "prediction_beyond": BEYOND,
        "required": {
            str(limit): not find_exceeded(found.ladder.best.errors, [limit]) for limit in limits
        },
        "residual": {
            name: None if math.isnan(size) else unit.from_si(size)
            for name, size, unit in zip(
                SIGNALS, found.bench.misses(found.fit.values), _DISPLAY, strict=True
            )
        },
        "parameters": {
            one.name: {
                "value": one.value,
                "unit": UNITS.get(one.name.partition(":")[0], ""),
                "standard_deviation": one.deviation,
                "interval": list(one.interval),
                "is_told": one.is_told,
            }
            for one in found.estimates
        },
        "keys": found.keys,
    }


def _stated(errors: Sequence[StrokeError]) -> dict[str, float | None]:
    return {
        f"{name}_{one.unit.replace('%', 'percent')}": _finite(stated_error(errors, name))
        for name, one in QUANTITIES.items()
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _digits(value: float, deviation: float) -> str:
    """Return a value with two digits more than its deviation has."""
    if not deviation > 0.0 or not math.isfinite(deviation):
        return f"{value:.6g}"
    places = max(0, 1 - math.floor(math.log10(deviation)))
    return f"{value:.{min(places, 12)}f}" if places else f"{value:.6g}"
