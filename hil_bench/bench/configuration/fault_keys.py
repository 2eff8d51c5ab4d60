"""The keys of `[[faults]]`, by the kind of the fault."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import Key
from hil_bench.config.values import choice, integer, number, text, zero_or
from hil_bench.devices.faults.kinds import BrokenReading, FaultDirection, FaultKind, LeakPath
from hil_bench.devices.j1939.diagnostics import HIGHEST_FMI, HIGHEST_SPN, Lamp
from hil_bench.devices.j1939.identifier import NULL
from hil_bench.devices.j1939.signal_table import Indication
from hil_bench.errors import ConfigError
from hil_bench.units import (
    BAR,
    BAR_PER_SECOND,
    DEGREE,
    DEGREE_PER_SECOND,
    LITRE_PER_MINUTE_BAR,
    MICROMETRE,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    MILLISECOND,
    NEWTON,
    ONE,
    PERCENT,
    PERCENT_PER_SECOND,
    SECOND,
    Unit,
)

KIND_KEY: Final = Key("kind", choice(FaultKind), example='"freeze"')

_LARGEST = 1e6
_SHORTEST_MS = 1e-3


def _lasting(value: object) -> float:
    """Return the time for which a fault lasts [s].

    Raises:
        ConfigError: it is no number, out of range, or 0.
    """
    found: float = number(SECOND, low=0.0, high=_LARGEST)(value)
    if not found:
        raise ConfigError("0 is no time; give how long the fault lasts, or leave the key out")
    return found


COMMON_KEYS: Final = (
    KIND_KEY,
    Key("target", text, example='"pressure_a"'),
    Key("at_s", number(SECOND, low=0.0, high=_LARGEST), 0.0, SECOND, "at"),
    Key("for_s", _lasting, None, SECOND, "duration"),
)


def _amount(name: str, unit: Unit, field: str, low: float = -_LARGEST) -> Key:
    return Key(name, number(unit, low=low, high=_LARGEST), None, unit, field)


_DIRECTION = Key("direction", choice(FaultDirection))
_CAN_ID = Key("can_id", integer(0, 0x1FFFFFFF))

_GROWTH = Key("growth_s", number(SECOND, low=0.0, high=_LARGEST), 0.0, SECOND, "growth")


def _share(name: str, field: str, default: float | None = None, example: str = "") -> Key:
    return Key(name, number(PERCENT, low=0.0, high=100.0), default, PERCENT, field, example)


OWN_KEYS: Final[Mapping[FaultKind, tuple[Key, ...]]] = MappingProxyType(
    {
        FaultKind.FREEZE: (),
        FaultKind.OFFSET: (
            _amount("offset_bar", BAR, "amount"),
            _amount("offset_mm", MILLIMETRE, "amount"),
            _amount("offset_deg", DEGREE, "amount"),
            _amount("offset_percent", PERCENT, "amount"),
        ),
        FaultKind.DRIFT: (
            _amount("drift_bar_s", BAR_PER_SECOND, "rate"),
            _amount("drift_mm_s", MILLIMETRE_PER_SECOND, "rate"),
            _amount("drift_deg_s", DEGREE_PER_SECOND, "rate"),
            _amount("drift_percent_s", PERCENT_PER_SECOND, "rate"),
        ),
        FaultKind.NOISE: (
            _amount("noise_bar", BAR, "rms", low=0.0),
            _amount("noise_mm", MILLIMETRE, "rms", low=0.0),
            _amount("noise_deg", DEGREE, "rms", low=0.0),
            _amount("noise_percent", PERCENT, "rms", low=0.0),
        ),
        FaultKind.BREAK_WIRE: (Key("reads", choice(BrokenReading), BrokenReading.NOTHING),),
        FaultKind.SLOW: (
            Key(
                "time_constant_ms",
                number(MILLISECOND, low=_SHORTEST_MS, high=_LARGEST),
                None,
                MILLISECOND,
                "time_constant",
                "100",
            ),
        ),
        FaultKind.STICK: (),
        FaultKind.INVERT: (),
        FaultKind.DISABLE: (),
        FaultKind.DROP_SUPPLY: (
            Key(
                "pressure_bar",
                number(BAR, low=-1.0, high=1e4),
                None,
                BAR,
                "pressure",
                "20",
            ),
        ),
        FaultKind.LEAK: (
            Key(
                "leak_l_min_bar",
                number(LITRE_PER_MINUTE_BAR, low=0.0, high=5.0),
                None,
                LITRE_PER_MINUTE_BAR,
                "conductance",
                "0.05",
            ),
            Key("path", choice(LeakPath), LeakPath.INTERNAL),
            _GROWTH,
        ),
        FaultKind.AERATE: (
            Key(
                "air_percent",
                number(PERCENT, low=0.0, high=50.0),
                None,
                PERCENT,
                "share",
                "2",
            ),
            _GROWTH,
        ),
        FaultKind.WEAR_SPOOL: (
            Key(
                "opening_um",
                number(MICROMETRE, low=0.0, high=500.0),
                None,
                MICROMETRE,
                "opening",
                "20",
            ),
            _GROWTH,
        ),
        FaultKind.JAM: (
            Key("force_n", number(NEWTON, low=0.0, high=1e9), None, NEWTON, "force", "5000"),
            _GROWTH,
        ),
        FaultKind.DROP_LOAD: (_share("loss_percent", "share", 100.0), _GROWTH),
        FaultKind.WEAR_PUMP: (_share("loss_percent", "share", 100.0), _GROWTH),
        FaultKind.SAG_RELIEF: (
            Key("sag_bar", number(BAR, low=0.0, high=1e4), None, BAR, "pressure", "50"),
            _GROWTH,
        ),
        FaultKind.LOSE_GAS: (_share("loss_percent", "share", 100.0), _GROWTH),
        FaultKind.CLOG_FILTER: (_share("blocked_percent", "share", 100.0), _GROWTH),
        FaultKind.BIND: (_share("band_percent", "band", None, "5"), _GROWTH),
        FaultKind.WEAKEN: (_share("travel_percent", "travel", None, "50"), _GROWTH),
        FaultKind.SILENCE: (),
        FaultKind.RESET: (),
        FaultKind.LOSE: (
            Key("share_percent", number(PERCENT, low=0.0, high=100.0), 100.0, PERCENT, "share"),
            _DIRECTION,
            _CAN_ID,
        ),
        FaultKind.DELAY: (
            Key(
                "delay_ms",
                zero_or(number(MILLISECOND, low=_SHORTEST_MS, high=_LARGEST)),
                None,
                MILLISECOND,
                "time",
                "5",
            ),
            _DIRECTION,
            _CAN_ID,
        ),
        FaultKind.TRUNCATE: (Key("length", integer(0, 8), example="4"), _DIRECTION, _CAN_ID),
        FaultKind.CORRUPT: (
            Key("share_percent", number(PERCENT, low=0.0, high=100.0), 100.0, PERCENT, "share"),
            _DIRECTION,
            _CAN_ID,
        ),
        FaultKind.REPEAT: (_DIRECTION, _CAN_ID),
        FaultKind.BIT_ERROR: (
            Key("share_percent", number(PERCENT, low=0.0, high=100.0), 100.0, PERCENT, "share"),
            _DIRECTION,
            _CAN_ID,
        ),
        FaultKind.BUS_OFF: (),
        FaultKind.STUCK_DOMINANT: (),
        FaultKind.NO_ACKNOWLEDGE: (),
        FaultKind.INDICATE: (Key("shows", choice(Indication), Indication.ERROR),),
        FaultKind.REPORT: (
            Key("spn", integer(0, HIGHEST_SPN), example="1907"),
            Key("fmi", integer(0, HIGHEST_FMI), example="2"),
            Key("lamp", choice([lamp.name.lower() for lamp in Lamp]), Lamp.WARNING.name.lower()),
        ),
        FaultKind.READDRESS: (Key("address", integer(0, NULL - 1), example="200"),),
        FaultKind.BABBLE: (Key("frames_per_tick", integer(1, 1000), 4), _CAN_ID),
    }
)
"""What each kind has beside the common keys."""

_NO_AMOUNTS = frozenset({"growth_s", "pressure_bar", "time_constant_ms"})


def idle_value(key: Key) -> float | None:
    """Return the value of an amount at which its fault changes nothing; None for other keys."""
    if key.unit is ONE or key.name in _NO_AMOUNTS:
        return None
    return 100.0 if key.name == "travel_percent" else 0.0
