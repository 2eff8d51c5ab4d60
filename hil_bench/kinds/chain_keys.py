"""The keys of `[nodes.NAME.chain]`, a sensor's measuring chain, and the presets for them.

`chain.tsv` declares each key, by the SI unit of what the chain carries where it depends on that.
The sources of the presets are told in `docs/measuring-chain.md`.
"""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final

from hil_bench.config.rows import read_rows, with_words
from hil_bench.config.settings import Key
from hil_bench.config.values import Value, choice
from hil_bench.devices.measurement.parameters import OverRange


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


_PRESETS_OF: Final = {"Pa": PressurePreset, "m": PositionPreset, "rad": AnglePreset}
_GROUPS: Final = read_rows(Path(__file__).with_name("chain.tsv")).groups


def _keys(unit: str, presets: type[StrEnum]) -> tuple[Key, ...]:
    keys = (*_GROUPS[unit], *_GROUPS["all"], *(() if unit == "Pa" else _GROUPS["speed"]))
    return tuple(with_words(keys, {"preset": choice(presets), "over_range": choice(OverRange)}))


CHAIN_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {unit: _keys(unit, presets) for unit, presets in _PRESETS_OF.items()}
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
