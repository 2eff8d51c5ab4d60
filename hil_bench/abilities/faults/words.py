"""The choices of keys of faults, as they are named in `bench.toml`."""

from enum import StrEnum


class LeakPath(StrEnum):
    """Between what oil leaks."""

    INTERNAL = "internal"
    A = "a"
    B = "b"


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
