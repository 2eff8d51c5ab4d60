"""The keys of a commissioning plan: name, unit, default; docs/commissioning.md tells the meaning.

What is given as a share of the data sheet's value (``..._tolerance_percent``) is right within that
share of it, either way.
"""

from collections.abc import Mapping

from hil_bench.config.settings import Key
from hil_bench.config.values import interval, number, text
from hil_bench.units import (
    BAR,
    HERTZ,
    MICROMETRE,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    MILLISECOND,
    PERCENT,
    Unit,
)

SECOND = Unit("s", "_s")

BAR_PER_SECOND = Unit("bar/s", "_bar_s", 1e5)
MILLIMETRE_PER_MINUTE = Unit("mm/min", "_mm_min", 1e-3 / 60.0)


def _quantity(name: str, default: float, unit: Unit, low: float, high: float) -> Key:
    """Return a key whose field is its name without the unit."""
    field = name.removesuffix(unit.suffix)
    return Key(name, number(unit, low=low, high=high), default, unit, field)


def _opening(default: float) -> Key:
    return _quantity("opening_percent", default, PERCENT, 1.0, 100.0)


def _duration(default: float, high: float = 60.0) -> Key:
    return _quantity("duration_s", default, SECOND, 0.05, high)


def _tolerance(name: str, default: float) -> Key:
    return _quantity(f"{name}_tolerance_percent", default, PERCENT, 0.0, 1000.0)


PLAN_KEYS = (
    Key("bench", text),
    Key("axis", text),
    _quantity("period_ms", 2.0, MILLISECOND, 1.0, 20.0),
)

LIMIT_KEYS = (
    Key("position_mm", interval(MILLIMETRE), None, MILLIMETRE, "position", "[-100, 100]"),
    Key(
        "speed_mm_s",
        number(MILLIMETRE_PER_SECOND, low=0.001, high=10_000.0),
        None,
        MILLIMETRE_PER_SECOND,
        "speed",
        "400",
    ),
    Key("pressure_bar", interval(BAR), None, BAR, "pressure", "[-1, 120]"),
    _quantity("time_s", 60.0, SECOND, 0.1, 3600.0),
    Key(
        "contact_speed_mm_s",
        number(MILLIMETRE_PER_SECOND, low=0.001, high=1000.0),
        None,
        MILLIMETRE_PER_SECOND,
        "contact_speed",
    ),
)

STEP_LIMIT_KEYS = tuple(key._replace(default=None, example="") for key in LIMIT_KEYS)
"""A step's own limits; what it does not give is as in ``[limits]``."""

STEP_KEYS: Mapping[str, tuple[Key, ...]] = {
    "communication": (),
    "sensors": (
        _duration(2.0),
        _quantity("position_noise_um", 50.0, MICROMETRE, 0.0, 1e6),
        _quantity("pressure_noise_bar", 0.5, BAR, 0.0, 1e3),
        _quantity("position_drift_mm_min", 2.0, MILLIMETRE_PER_MINUTE, 0.0, 1e3),
        _quantity("pressure_drift_bar_s", 0.5, BAR_PER_SECOND, 0.0, 1e3),
    ),
    "direction": (_opening(40.0), _duration(0.4, 5.0)),
    "dead_band": (
        _opening(50.0),
        _duration(4.0),
        _quantity("zero_percent", 3.0, PERCENT, 0.0, 100.0),
        _tolerance("dead_band", 30.0),
    ),
    "ramp": (
        _opening(65.0),
        _duration(3.0),
        _tolerance("gain", 30.0),
        _quantity("asymmetry_percent", 15.0, PERCENT, 0.0, 1000.0),
        _tolerance("friction", 60.0),
    ),
    "steps": (
        _opening(50.0),
        _duration(0.5, 10.0),
        _quantity("rise_time_ms", 20.0, MILLISECOND, 0.0, 1e4),
        _tolerance("speed", 30.0),
    ),
    "chirp": (
        _opening(45.0),
        _duration(1.5, 10.0),
        _quantity("amplitude_percent", 6.0, PERCENT, 0.1, 50.0),
        _quantity("start_hz", 5.0, HERTZ, 0.1, 1000.0),
        _quantity("end_hz", 150.0, HERTZ, 0.1, 1000.0),
        _tolerance("frequency", 15.0),
        _quantity("smallest_damping", 0.01, Unit("", ""), 0.0, 10.0),
    ),
    "leakage": (
        _opening(40.0),
        _duration(5.0),
        _quantity("motion_time_s", 0.3, SECOND, 0.0, 5.0),
        _quantity("position_drift_mm_min", 2.0, MILLIMETRE_PER_MINUTE, 0.0, 1e3),
        _quantity("pressure_drift_bar_s", 0.5, BAR_PER_SECOND, 0.0, 1e3),
    ),
}
