"""The keys of `[nodes.NAME.chain]`, a sensor's measuring chain, and the presets for them.

The sources of the presets are told in `docs/measuring-chain.md`.
"""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import CLOCK_MICROSECOND, Key
from hil_bench.config.values import (
    Reader,
    Value,
    choice,
    integer,
    interval,
    number,
    points,
    zero_or,
)
from hil_bench.devices.measurement.parameters import OverRange
from hil_bench.units import (
    BAR,
    BAR_PER_KELVIN,
    BAR_PER_ROOT_HERTZ,
    DEGREE,
    DEGREE_PER_KELVIN,
    DEGREE_PER_ROOT_HERTZ,
    HERTZ,
    METRE,
    MICROMETRE,
    MICROMETRE_PER_KELVIN,
    MICROMETRE_PER_ROOT_HERTZ,
    MILLIMETRE,
    PASCAL,
    PERCENT,
    PPM_PER_KELVIN,
    RADIAN,
    SECOND_AND_KELVIN,
    Unit,
)

_LONGEST_US: Final = 1_000_000
_SHORTEST_PERIOD_US: Final = 10  # a tick would have too many samples
_SMALLEST, _LARGEST = 1e-6, 1e6  # in the unit of the key; what is beyond is a slip of the pen


class PressurePreset(StrEnum):
    """Classes of pressure transducers."""

    IDEAL = "ideal"
    CLASS_025_250_BAR = "class_0.25_250_bar"


class AnglePreset(StrEnum):
    """Classes of rotary position sensors."""

    IDEAL = "ideal"


class PositionPreset(StrEnum):
    """Classes of position sensors."""

    IDEAL = "ideal"
    MAGNETOSTRICTIVE_1_UM = "magnetostrictive_1_um"


def _number(unit: Unit) -> Reader:
    return number(unit, low=-_LARGEST, high=_LARGEST)


def _amount(name: str, unit: Unit, field: str) -> Key:
    return Key(name, zero_or(number(unit, low=_SMALLEST, high=_LARGEST)), 0.0, unit, field)


def _microseconds(name: str, field: str, low: int = 0) -> Key:
    return Key(name, zero_or(integer(low, _LONGEST_US)), 0, CLOCK_MICROSECOND, field)


_GAIN_KEYS = (
    Key("gain_error_percent", _number(PERCENT), 0.0, PERCENT, "gain_error"),
    Key("gain_drift_ppm_k", _number(PPM_PER_KELVIN), 0.0, PPM_PER_KELVIN, "gain_drift"),
    Key("warming_s_k", points(SECOND_AND_KELVIN), (), SECOND_AND_KELVIN, "temperature"),
)

_DYNAMIC_KEYS = (
    _amount("bandwidth_hz", HERTZ, "bandwidth"),
    Key("filter_order", integer(1, 2), 1, field="order"),
    Key("damping_ratio", number(low=0.01, high=100.0), 0.7),
    _microseconds("sampling_period_us", "sampling_period_ns", _SHORTEST_PERIOD_US),
    _microseconds("sampling_phase_us", "sampling_phase_ns"),
    _microseconds("delay_us", "delay_ns"),
    Key("over_range", choice(OverRange), OverRange.SATURATE),
)

_PRESSURE_KEYS = (
    Key("preset", choice(PressurePreset), PressurePreset.IDEAL),
    Key("offset_error_bar", _number(BAR), 0.0, BAR, "offset_error"),
    Key("offset_drift_bar_k", _number(BAR_PER_KELVIN), 0.0, BAR_PER_KELVIN, "offset_drift"),
    _amount("hysteresis_bar", BAR, "hysteresis"),
    _amount("noise_density_bar_rthz", BAR_PER_ROOT_HERTZ, "noise_density"),
    _amount("noise_rms_bar", BAR, "noise_rms"),
    _amount("resolution_bar", BAR, "resolution"),
    Key("range_bar", interval(BAR), None, BAR, "range"),
    *_GAIN_KEYS,
    *_DYNAMIC_KEYS,
)

_POSITION_KEYS = (
    Key("preset", choice(PositionPreset), PositionPreset.IDEAL),
    Key("offset_error_mm", _number(MILLIMETRE), 0.0, MILLIMETRE, "offset_error"),
    Key(
        "offset_drift_um_k",
        _number(MICROMETRE_PER_KELVIN),
        0.0,
        MICROMETRE_PER_KELVIN,
        "offset_drift",
    ),
    _amount("hysteresis_um", MICROMETRE, "hysteresis"),
    _amount("noise_density_um_rthz", MICROMETRE_PER_ROOT_HERTZ, "noise_density"),
    _amount("noise_rms_um", MICROMETRE, "noise_rms"),
    _amount("resolution_um", MICROMETRE, "resolution"),
    Key("range_mm", interval(MILLIMETRE), None, MILLIMETRE, "range"),
    *_GAIN_KEYS,
    *_DYNAMIC_KEYS,
    _microseconds("speed_window_us", "speed_window_ns"),
)

_ANGLE_KEYS = (
    Key("preset", choice(AnglePreset), AnglePreset.IDEAL),
    Key("offset_error_deg", _number(DEGREE), 0.0, DEGREE, "offset_error"),
    Key("offset_drift_deg_k", _number(DEGREE_PER_KELVIN), 0.0, DEGREE_PER_KELVIN, "offset_drift"),
    _amount("hysteresis_deg", DEGREE, "hysteresis"),
    _amount("noise_density_deg_rthz", DEGREE_PER_ROOT_HERTZ, "noise_density"),
    _amount("noise_rms_deg", DEGREE, "noise_rms"),
    _amount("resolution_deg", DEGREE, "resolution"),
    Key("range_deg", interval(DEGREE), None, DEGREE, "range"),
    *_GAIN_KEYS,
    *_DYNAMIC_KEYS,
    _microseconds("speed_window_us", "speed_window_ns"),
)

CHAIN_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {
        PASCAL.symbol: _PRESSURE_KEYS,
        METRE.symbol: _POSITION_KEYS,
        RADIAN.symbol: _ANGLE_KEYS,
    }
)
"""By the SI unit of what the chain carries; what is in another unit has no chain."""

PRESETS: Final[Mapping[StrEnum, Mapping[str, Value]]] = MappingProxyType(
    {
        PressurePreset.IDEAL: {},
        PressurePreset.CLASS_025_250_BAR: {
            "offset_error_bar": 0.25,
            "offset_drift_bar_k": 0.02,
            "hysteresis_bar": 0.25,
            "noise_rms_bar": 0.04,
            "resolution_bar": 0.004,
            "range_bar": (-12.5, 275.0),
            "gain_error_percent": 0.1,
            "gain_drift_ppm_k": 80.0,
            "bandwidth_hz": 233.0,
            "sampling_period_us": 1000,
        },
        AnglePreset.IDEAL: {},
        PositionPreset.IDEAL: {},
        PositionPreset.MAGNETOSTRICTIVE_1_UM: {
            "hysteresis_um": 4.0,
            "noise_rms_um": 0.8,
            "resolution_um": 1.0,
            "gain_error_percent": 0.01,
            "gain_drift_ppm_k": 35.0,
            "sampling_period_us": 1000,
            "delay_us": 1000,
            "over_range": OverRange.INVALID,
            "speed_window_us": 10_000,
        },
    }
)
"""Defaults of the keys, by preset; a key that is not there has its own default."""
