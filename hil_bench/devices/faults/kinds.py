"""The kinds of faults and their choices, as they are named in `bench.toml`."""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Final


class FaultKind(StrEnum):
    """The kinds of fault; each is a verb of `hil_bench.devices.faults.faults.Faults`."""

    FREEZE = "freeze"
    OFFSET = "offset"
    DRIFT = "drift"
    NOISE = "noise"
    BREAK_WIRE = "break_wire"
    SLOW = "slow"
    STICK = "stick"
    INVERT = "invert"
    DISABLE = "disable"
    DROP_SUPPLY = "drop_supply"
    LEAK = "leak"
    AERATE = "aerate"
    WEAR_SPOOL = "wear_spool"
    JAM = "jam"
    DROP_LOAD = "drop_load"
    WEAR_PUMP = "wear_pump"
    SAG_RELIEF = "sag_relief"
    LOSE_GAS = "lose_gas"
    CLOG_FILTER = "clog_filter"
    BIND = "bind"
    WEAKEN = "weaken"
    SILENCE = "silence"
    RESET = "reset"
    LOSE = "lose"
    DELAY = "delay"
    TRUNCATE = "truncate"
    CORRUPT = "corrupt"
    REPEAT = "repeat"
    BABBLE = "babble"
    BIT_ERROR = "bit_error"
    BUS_OFF = "bus_off"
    STUCK_DOMINANT = "stuck_dominant"
    NO_ACKNOWLEDGE = "no_acknowledge"
    INDICATE = "indicate"
    REPORT = "report"
    READDRESS = "readdress"


SENSOR_KINDS = frozenset(
    {FaultKind.FREEZE, FaultKind.OFFSET, FaultKind.DRIFT, FaultKind.NOISE, FaultKind.BREAK_WIRE}
)
"""Kinds that only a sensor may have."""

VALVE_KINDS = frozenset(
    {
        FaultKind.STICK,
        FaultKind.INVERT,
        FaultKind.DISABLE,
        FaultKind.BIND,
        FaultKind.WEAKEN,
    }
)
"""Kinds that only a valve may have."""


DEFECTS: Final[Mapping[FaultKind, str]] = MappingProxyType(
    {
        FaultKind.AERATE: "entrained_air",
        FaultKind.WEAR_SPOOL: "null_opening",
        FaultKind.JAM: "dry_friction",
        FaultKind.DROP_LOAD: "load_loss",
        FaultKind.WEAR_PUMP: "pump_loss",
        FaultKind.SAG_RELIEF: "relief_sag",
        FaultKind.LOSE_GAS: "gas_loss",
        FaultKind.CLOG_FILTER: "filter_clogging",
    }
)
"""The defect of a plant that each of these kinds is; that of a leak depends on its path."""

WIRE_KINDS = frozenset(
    {
        FaultKind.BIT_ERROR,
        FaultKind.BUS_OFF,
        FaultKind.STUCK_DOMINANT,
        FaultKind.NO_ACKNOWLEDGE,
    }
)
"""Kinds that only a node may have whose bus is of copper."""

ECU_KINDS = frozenset({FaultKind.INDICATE, FaultKind.REPORT, FaultKind.READDRESS})
"""Kinds that only a J1939 device may have."""

DEFECT_KINDS = frozenset({FaultKind.LEAK, *DEFECTS})
"""Kinds that only the plant of an axis may have."""


class LeakPath(StrEnum):
    """Between what oil leaks."""

    INTERNAL = "internal"
    A = "a"
    B = "b"


LEAKS: Final[Mapping[LeakPath, str]] = MappingProxyType(
    {
        LeakPath.INTERNAL: "internal_leakage",
        LeakPath.A: "leakage_a",
        LeakPath.B: "leakage_b",
    }
)
"""The defect that a leak by each path is."""


class BrokenReading(StrEnum):
    """The reading of a sensor behind a broken wire."""

    NOTHING = "nothing"
    LOW = "low"
    HIGH = "high"


class FaultDirection(StrEnum):
    """The direction of the frames that a fault meets."""

    BOTH = "both"
    SENT = "sent"
    RECEIVED = "received"
