"""Doubts about a configuration: values that no machine has, motion that no step resolves."""

import math
from collections.abc import Iterator, Mapping, Sequence

from hil_bench.config.plausible_ranges import MISTAKEN, POSSIBLE, USUAL, Range
from hil_bench.config.records import AxisConfig, BenchConfig
from hil_bench.tables.settings import Problems, Setting, Settings, quote_name

_PREFIXES = {1e-9: "n", 1e-6: "u", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G", 1e12: "T"}
_BASES = {"bar": "Pa", "MPa": "Pa", "Pa": "Pa", "mm": "m", "N": "N", "kg": "g"}
"""Units whose values read well with a prefix, and what takes it."""
_GRAMS = 1e3

_SHARE = 1e-3
"""Next to nothing is usual in many units: that shows no mistake."""

SAMPLES_PER_PERIOD = 4.0
"""Ticks that a controller needs at least to see an oscillation."""
STEPS_PER_PERIOD = 12.0
"""Steps that the solver needs: the midpoint rule's phase is off by (omega dt)²/12, so by 2 %."""


def check_possible(axes: Mapping[str, Settings], problems: Problems) -> None:
    """Note values of the axes' keys that nature does not allow."""
    for axis in axes.values():
        for setting in axis.values():
            possible = POSSIBLE.get(setting.key.name)
            if possible is not None and not _is_within(setting, possible):
                place = problems.place(setting.table, setting.key.name)
                problems.add(place, _explain(setting, possible, "possible"))


def find_doubts(config: BenchConfig) -> list[str]:
    """Return what of a configuration is hard to believe, a line each."""
    source = str(config.path) if config.path else "built-in bench"
    return [*_unusual(source, config.settings), *_unresolved(source, config)]


def _unusual(source: str, settings: Sequence[Setting]) -> Iterator[str]:
    for setting in settings:
        usual = USUAL.get(setting.key.name)
        if setting.table.startswith("plant.") and usual and not _is_within(setting, usual):
            place = f"{source}:{setting.table}.{quote_name(setting.key.name)}"
            yield f"{place}: {_explain(setting, usual, 'usual')}"


def _is_within(setting: Setting, allowed: Range) -> bool:
    value = setting.value
    return value is None or allowed.low <= value <= allowed.high


def _explain(setting: Setting, allowed: Range, what: str) -> str:
    """Return what the value is, what would be right, and which unit it may have been meant in."""
    value, unit = setting.value, setting.key.unit
    text = f"{value:.10g}{_in_prefixed_units(value, setting)}; {_range_text(allowed)} is {what}"
    usual = USUAL.get(setting.key.name, allowed)
    for other, factor in MISTAKEN.get(unit.symbol, {}).items():
        meant = value * factor
        if usual.low <= meant <= usual.high and abs(meant) >= _SHARE * usual.high:
            return f"{text} ({allowed.reason}); {other} in the {unit.symbol} key?"
    return f"{text} ({allowed.reason})"


def _in_prefixed_units(value: float, setting: Setting) -> str:
    """Return the value as people say it, such as 2.1 TPa; empty where the key's unit does."""
    unit = setting.key.unit
    base = _BASES.get(unit.symbol)
    if base is None or not value:
        return ""
    size = abs(value * unit.factor * (_GRAMS if base == "g" else 1.0))
    if setting.key.field == "h":  # the stroke's key converts to half of it
        size *= 2.0
    prefix = max((one for one in _PREFIXES if one <= size), default=min(_PREFIXES))
    said = f"{math.copysign(size / prefix, value):.3g} {_PREFIXES[prefix]}{base}"
    return "" if said == f"{value:.3g} {unit.symbol}" else f" is {said}"


def _range_text(allowed: Range) -> str:
    if math.isinf(allowed.high):
        return f"{allowed.low:.10g} or more"
    if math.isinf(allowed.low):
        return f"up to {allowed.high:.10g}"
    return f"{allowed.low:.10g} to {allowed.high:.10g}"


def _short(number: float) -> str:
    """Return a number with three digits that count, and no exponent where it has up to ten."""
    return f"{float(f'{number:.3g}'):.10g}"


def _unresolved(source: str, config: BenchConfig) -> Iterator[str]:
    """Yield the oscillations that are too fast for the tick, or for the solver's step."""
    tick, step = config.tick_ns * 1e-9, config.dt
    for axis in config.axes:
        place = f"{source}:plant.{quote_name(axis.name)}"
        at_centre, fastest = eigenfrequencies(axis)
        if at_centre * tick * SAMPLES_PER_PERIOD > 1.0:
            yield (
                f"{place}: the cylinder's eigenfrequency is {_short(at_centre)} Hz at mid-stroke, "
                f"{1.0 / (at_centre * tick):.2g} ticks of tick_us = {config.tick_ns // 1000} a "
                f"period; {_right_us(at_centre, SAMPLES_PER_PERIOD)} us or less resolves it"
            )
        spool = axis.parameters.omega_0 / (2.0 * math.pi)
        for what, frequency in (
            ("the cylinder's eigenfrequency near its end stop", fastest),
            ("the spool's natural frequency", spool),
        ):
            if frequency * step * STEPS_PER_PERIOD > 1.0:
                steps = 1.0 / (frequency * step)
                yield (
                    f"{place}: {what} is {_short(frequency)} Hz, {steps:.2g} steps of step_us = "
                    f"{config.step_ns // 1000} a period; "
                    f"{_right_us(frequency, STEPS_PER_PERIOD)} us or less resolves it"
                )


def eigenfrequencies(axis: AxisConfig) -> tuple[float, float]:
    """Return the cylinder's eigenfrequency at mid-stroke and at its stiffer end [Hz].

    Both chambers are springs: omega² = E (A_A² / V_A + A_B² / V_B) / m.
    """
    p = axis.parameters
    mass = p.m + axis.options.load_mass

    def at(x: float) -> float:
        stiffness = p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x)
        return math.sqrt(p.E * stiffness / mass) / (2.0 * math.pi)

    return at(0.0), max(at(-p.h), at(p.h))


def _right_us(frequency: float, samples: float) -> str:
    limit = 1e6 / (frequency * samples)
    return f"{limit:.2g}" if limit < 10.0 else f"{math.floor(limit)}"
