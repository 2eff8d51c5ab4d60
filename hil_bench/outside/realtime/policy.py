"""The policy of a paced loop: requests to the operating system, and reaction to overruns."""

from dataclasses import dataclass
from enum import StrEnum


class RealtimePolicy(StrEnum):
    """The scheduling policy of a paced loop."""

    OFF = "off"
    FIFO = "fifo"
    DEADLINE = "deadline"


class OverrunPolicy(StrEnum):
    """The reaction of a paced loop to a tick that took longer than its period."""

    COUNT = "count"
    SKIP = "skip"
    STOP = "stop"


@dataclass(frozen=True, slots=True)
class RealtimeConfig:
    """The real-time settings of a paced loop.

    Attributes:
        policy: with which real-time policy.
        priority: of SCHED_FIFO, 1 to 98.
        cpu: the only processor on which it runs, None for any.
        spin: for how long before each tick it waits busily, in place of being woken [ns].
        overrun: what it does after a tick that took too long.
    """

    policy: RealtimePolicy = RealtimePolicy.OFF
    priority: int = 80
    cpu: int | None = None
    spin: int = 0
    overrun: OverrunPolicy = OverrunPolicy.COUNT
