"""The tables ``[nodes.NAME.chain]``: what lies between the plant and a sensor's objects."""

import itertools
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final

from hil_bench.config import settings
from hil_bench.config.rows import read_rows, with_words
from hil_bench.config.values import Value, choice
from hil_bench.devices.measurement.low_pass import ChainParameters, OverRange

# The keys of `[nodes.NAME.chain]`, a sensor's measuring chain, and the presets for them.
#
# `chain.tsv` declares each key, by the SI unit of what the chain carries where it depends on
# that. The sources of the presets are in `docs/measuring-chain.md`.


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


def _keys(unit: str, presets: type[StrEnum]) -> tuple[settings.Key, ...]:
    keys = (*_GROUPS[unit], *_GROUPS["all"], *(() if unit == "Pa" else _GROUPS["speed"]))
    return tuple(with_words(keys, {"preset": choice(presets), "over_range": choice(OverRange)}))


CHAIN_KEYS: Final[Mapping[str, tuple[settings.Key, ...]]] = MappingProxyType(
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


CHAIN_TABLE = "chain"
"""Name of the table of a measuring chain, within the table of its sensor."""

_MOST_WARMTH = 1000  # [K]


def read_chain(
    node: str, unit: str | None, given: settings.Given | None, problems: settings.Problems
) -> settings.Settings | None:
    """Return the settings of a chain; None where nothing has one, or where there is a problem.

    Args:
        node: the sensor's table, as in ``nodes.NAME``.
        unit: SI unit of what the chain carries; None where the device has no chain.
        given: what stands in its `chain`, if anything.
        problems: where problems are noted.
    """
    table = f"{node}.{CHAIN_TABLE}"
    if unit is None:
        return None
    keys = CHAIN_KEYS[unit]
    if given is None:
        return settings.read_table(table, {}, keys, problems)
    values = settings.open_table(table, given, problems)
    return _with_preset(settings.read_table(table, values, keys, problems))


def check_chains(chains: Mapping[str, settings.Settings], problems: settings.Problems) -> None:
    """Note values of the nodes' chains, given by node, that do not go together."""
    for name, chain in chains.items():
        check_chain(f"nodes.{name}.{CHAIN_TABLE}", chain, problems)


def check_chain(table: str, chain: settings.Settings, problems: settings.Problems) -> None:
    """Note values of the chain in `table` that do not go together."""
    period, phase = (chain[f"sampling_{name}_us"].value for name in ("period", "phase"))
    if phase and phase >= period:
        right = f"give 0 to {period - 1}" if period else "give sampling_period_us too"
        place = problems.place(table, "sampling_phase_us")
        problems.add(place, f"{phase} is not below sampling_period_us = {period}; {right}")
    (density,) = (setting for name, setting in chain.items() if name.startswith("noise_density"))
    if density.value and not chain["bandwidth_hz"].value:
        place = problems.place(table, density.key.name)
        problems.add(place, "has no bandwidth to fill; give bandwidth_hz too")
    _check_warming(table, chain["warming_s_k"].value, problems)


def build_chain(unit: str, chain: settings.Settings) -> ChainParameters:
    """Return the record of a checked chain."""
    keys = [key for key in CHAIN_KEYS[unit] if key.name != "preset"]
    return ChainParameters(**settings.convert(chain, keys))


def preset_chain(unit: str, preset: StrEnum) -> ChainParameters:
    """Return the measuring chain of a preset, for an SI unit, without further values."""
    problems = settings.Problems(f"preset {preset}")
    given = settings.Given(
        {"preset": preset.value}, settings.Origin.FILE, problems.place(CHAIN_TABLE)
    )
    chain = read_chain("nodes.sensor", unit, given, problems)
    problems.raise_any()
    return build_chain(unit, chain or {})


def _with_preset(chain: settings.Settings) -> settings.Settings:
    """Return the settings in which the preset's values take the place of the keys' defaults."""
    preset = PRESETS[chain["preset"].value] if "preset" in chain else {}
    return {
        name: setting._replace(value=preset[name])
        if setting.origin is settings.Origin.DEFAULT and name in preset
        else setting
        for name, setting in chain.items()
    }


def _check_warming(
    table: str, points: tuple[tuple[float, float], ...], problems: settings.Problems
) -> None:
    for (before, _), (after, _) in itertools.pairwise(points):
        if after < before:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{after:g} s after {before:g} s; give times that do not decrease")
    for _, warmth in points:
        if abs(warmth) > _MOST_WARMTH:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{warmth:g} K is out of range; give at most {_MOST_WARMTH} K")
