"""The choice of sought and held parameters: by data sheet, sensors' chains and user."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.unknowns import (
    EXTRAS,
    KINDS,
    PROMPT,
    SENSING,
    SESSION_FLOW,
    Sensors,
)
from hil_bench.config.settings import Key, Origin, Setting
from hil_bench.config.values import find_nearest, number
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.keys import PARAMETER_KEYS
from hil_bench.units import BAR, MILLIMETRE, MILLISECOND, ONE

_SECOND_NS = 1e9

KEYS: Mapping[str, Key] = {
    **{key.field: key for key in PARAMETER_KEYS},
    "gain": Key("command_gain", number(), 1.0, ONE, "gain"),
    SESSION_FLOW: Key(SESSION_FLOW, number(), 1.0, ONE, SESSION_FLOW),
    **{name: Key(f"{name}_ms", number(MILLISECOND), 0.0, MILLISECOND, name) for name in SENSING},
}
"""The key of each unknown: those of `bench.toml`, and the others'."""


class Choice(NamedTuple):
    """The sought parameters.

    Attributes:
        names: the sought parameters.
        held: the keys that are held, with the reason.
    """

    names: tuple[str, ...]
    held: dict[str, str]


def choose(
    settings: Iterable[Setting], sensors: Sensors, fix: Sequence[str], free: Sequence[str]
) -> Choice:
    """Choose the sought parameters.

    What the data sheet determines is held, but not what is typical only. A delay or lag that the
    sensors are configured to have is sought.

    Args:
        settings: of the axis.
        sensors: as configured.
        fix: keys that the user holds.
        free: keys that the user has sought.

    Raises:
        ConfigError: a key is no unknown, or is to be both, or nothing is left.
    """
    unknown = {KEYS[name].name: name for name in (*KINDS, *EXTRAS)}
    for option, keys in (("--fix", fix), ("--free", free)):
        for key in keys:
            if key not in unknown:
                nearest = find_nearest(key, unknown)
                raise ConfigError(f"{option} {key}: is no unknown; the nearest one is {nearest}")
    if both := set(fix) & set(free):
        raise ConfigError(f"--fix {min(both)}: --free says the contrary")
    held = {
        setting.key.name: setting.reason
        for setting in settings
        if setting.key.name in unknown
        and setting.key.name != KEYS["h"].name
        and setting.origin is Origin.DATA_SHEET
        and "typical" not in setting.reason
    }
    held = {key: reason for key, reason in held.items() if key not in free}
    held |= dict.fromkeys(fix, "by --fix")
    late = {name for name, value in zip(SENSING, sensors, strict=True) if value}
    wanted = {*KINDS, *late, *(unknown[key] for key in free)}
    names = tuple(name for key, name in unknown.items() if name in wanted and key not in held)
    if not names:
        raise ConfigError("--fix: nothing is left to be sought")
    return Choice(names, held)


def find_sensors(position: ChainParameters | None, pressure: ChainParameters | None) -> Sensors:
    """Return the sensors' delays and lags by their chains; a sample is half a period old."""
    if position is None and pressure is None:
        return PROMPT
    return Sensors(*_late(position), *_late(pressure))


def with_filters(
    sensors: Sensors, filters: tuple[float, float, float], fix: Sequence[str]
) -> Sensors:
    """Return sensors with the lags that their noise shows, where none is configured or held.

    Args:
        sensors: as configured.
        filters: time constant behind the noise of position, P_A and P_B, 0 for none [s].
        fix: keys that the user holds.
    """
    pressures = [lag for lag in filters[1:] if lag]
    found = {
        "position_lag": filters[0],
        "pressure_lag": sum(pressures) / len(pressures) if pressures else 0.0,
    }
    return sensors._replace(
        **{
            name: lag
            for name, lag in found.items()
            if lag and not getattr(sensors, name) and KEYS[name].name not in fix
        }
    )


def with_hysteresis(
    record: AxisRecord, position: ChainParameters | None, pressure: ChainParameters | None
) -> AxisRecord:
    """Return a record that counts the hysteresis of its sensors as noise.

    Hysteresis is not in the model that is fitted. A sensor shows half the width of its loop too
    little on the way up and as much too much on the way down, which is its rms error as well.
    """
    half = [0.5 * chain.hysteresis if chain else 0.0 for chain in (position, pressure, pressure)]
    notes = [
        f"hysteresis counted as noise: {display.from_si(width):.3g} {display.symbol} of {what}"
        for what, width, display in (
            ("the position", half[0], MILLIMETRE),
            ("the pressures", half[1], BAR),
        )
        if width
    ]
    noise = np.hypot(record.noise, half)
    return replace(record.with_noise(noise), notes=(*record.notes, *notes))


def _late(chain: ChainParameters | None) -> tuple[float, float]:
    """Return delay and first-order lag of a chain [s]."""
    if chain is None or not (chain.delay_ns or chain.bandwidth):
        return 0.0, 0.0
    delay = (chain.delay_ns + 0.5 * chain.sampling_period_ns) / _SECOND_NS
    return delay, 1.0 / (math.tau * chain.bandwidth) if chain.bandwidth else 0.0
