"""The kinds of faults and their choices, as they are named in `bench.toml`."""

from enum import StrEnum


class FaultKind(StrEnum):
    """What goes wrong; each is a verb of `hil_bench.devices.faults.faults.Faults`."""

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
    SILENCE = "silence"
    RESET = "reset"
    LOSE = "lose"
    DELAY = "delay"
    TRUNCATE = "truncate"
    BABBLE = "babble"


SENSOR_KINDS = frozenset(
    {FaultKind.FREEZE, FaultKind.OFFSET, FaultKind.DRIFT, FaultKind.NOISE, FaultKind.BREAK_WIRE}
)
"""Kinds that only a sensor may have."""

VALVE_KINDS = frozenset({FaultKind.STICK, FaultKind.INVERT, FaultKind.DISABLE})
"""Kinds that only a valve may have."""


class Reading(StrEnum):
    """What a sensor reads behind a broken wire."""

    NOTHING = "nothing"
    LOW = "low"
    HIGH = "high"


class Direction(StrEnum):
    """Which frames of a node a fault meets."""

    BOTH = "both"
    SENT = "sent"
    RECEIVED = "received"
