"""The tables ``[nodes.NAME.chain]``: what lies between the plant and a sensor's objects."""

import itertools
from collections.abc import Mapping
from enum import StrEnum

from hil_bench.config.settings import (
    Given,
    Origin,
    Problems,
    Settings,
    convert,
    open_table,
    read_table,
)
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.kinds.chain_keys import CHAIN_KEYS, PRESETS

CHAIN_TABLE = "chain"
"""Name of the table of a measuring chain, within the table of its sensor."""

_MOST_WARMTH = 1000  # [K]


def read_chain(
    node: str, unit: str | None, given: Given | None, problems: Problems
) -> Settings | None:
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
        return read_table(table, {}, keys, problems)
    values = open_table(table, given, problems)
    return _with_preset(read_table(table, values, keys, problems))


def check_chains(chains: Mapping[str, Settings], problems: Problems) -> None:
    """Note values of the nodes' chains, given by node, that do not go together."""
    for name, chain in chains.items():
        check_chain(f"nodes.{name}.{CHAIN_TABLE}", chain, problems)


def check_chain(table: str, chain: Settings, problems: Problems) -> None:
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


def build_chain(unit: str, chain: Settings) -> ChainParameters:
    """Return the record of a checked chain."""
    keys = [key for key in CHAIN_KEYS[unit] if key.name != "preset"]
    return ChainParameters(**convert(chain, keys))


def preset_chain(unit: str, preset: StrEnum) -> ChainParameters:
    """Return the measuring chain of a preset, for an SI unit, without further values."""
    problems = Problems(f"preset {preset}")
    given = Given({"preset": preset.value}, Origin.FILE, problems.place(CHAIN_TABLE))
    chain = read_chain("nodes.sensor", unit, given, problems)
    problems.raise_any()
    return build_chain(unit, chain or {})


def _with_preset(chain: Settings) -> Settings:
    """Return the settings in which the preset's values take the place of the keys' defaults."""
    preset = PRESETS[chain["preset"].value] if "preset" in chain else {}
    return {
        name: setting._replace(value=preset[name])
        if setting.origin is Origin.DEFAULT and name in preset
        else setting
        for name, setting in chain.items()
    }


def _check_warming(table: str, points: tuple[tuple[float, float], ...], problems: Problems) -> None:
    for (before, _), (after, _) in itertools.pairwise(points):
        if after < before:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{after:g} s after {before:g} s; give times that do not decrease")
    for _, warmth in points:
        if abs(warmth) > _MOST_WARMTH:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{warmth:g} K is out of range; give at most {_MOST_WARMTH} K")
