"""The words and numbers that faults accept, and refusals of others."""

import math
from enum import StrEnum
from typing import TypeVar

from hil_bench.errors import ConfigError

_Choice = TypeVar("_Choice", bound=StrEnum)

_LARGEST = 1e15
_LONGEST_S = 1e9
_HIGHEST_CAN_ID = 0x1FFFFFFF
_NS_PER_S = 1_000_000_000
_NS = 1e-9


def choose(name: str, choices: type[_Choice], value: str) -> _Choice:
    """Return a member of an enumeration by its value.

    Raises:
        ConfigError: it has none of that value.
    """
    if value in set(choices):
        return choices(value)
    known = ", ".join(f'"{choice}"' for choice in choices)
    raise ConfigError(f'faults: {name} = "{value}" is unknown; give one of {known}')


def bounded(name: str, value: float, *, low: float = -_LARGEST, high: float = _LARGEST) -> float:
    """Return a finite number between two bounds, both included.

    Raises:
        ConfigError: it is something else.
    """
    if not (math.isfinite(value) and low <= value <= high):
        raise ConfigError(
            f"faults: {name} = {value:g} is out of range; give a number from {low:g} to {high:g}"
        )
    return value


def count(name: str, value: int, low: int, high: int) -> int:
    """Return a whole number between two bounds, both included.

    Raises:
        ConfigError: it is something else.
    """
    if not low <= value <= high:
        raise ConfigError(
            f"faults: {name} = {value!r} is out of range; give an integer from {low} to {high}"
        )
    return value


def identifier(can_id: int | None) -> int | None:
    """Return an identifier of 11 or 29 bits, or None for any; ConfigError where it is neither."""
    return None if can_id is None else count("can_id", can_id, 0, _HIGHEST_CAN_ID)


def check_ahead(at: object, now: float) -> None:
    """Refuse that a fault begins in the past.

    Args:
        at: when [s]; something else than a number is for others to refuse.
        now: the bench time [s].

    Raises:
        ConfigError: that has passed.
    """
    if isinstance(at, int | float) and at < now - _NS:
        right = "give a later time, or leave it out"
        raise ConfigError(f"faults: at = {at:g} s has passed, for it is {now:g} s; {right}")


def to_ns(name: str, seconds: float) -> int:
    """Return a time [s] in nanoseconds; ConfigError where it is negative or endless."""
    return round(bounded(name, seconds, low=0.0, high=_LONGEST_S) * _NS_PER_S)


# The choices of keys of faults, as they are named in `bench.toml`.


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
