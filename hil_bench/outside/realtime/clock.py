"""Clocks: the one place where time is read, and the policy of those who wait on it."""

import math
import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class Clock(Protocol):
    """A monotonic time scale that can be waited on."""

    def now(self) -> int:
        """Return the time [ns] since an arbitrary, fixed moment."""

    def sleep_until(self, deadline: int) -> None:
        """Return when `now()` has reached `deadline` [ns]; at once when it has passed already."""


class MonotonicClock:
    """The machine's monotonic clock.

    `time.sleep` waits with `clock_nanosleep` to an absolute time since Python 3.11, which
    docs/decisions/0005-transports-and-pace.md compares with calling it directly.
    """

    @staticmethod
    def now() -> int:
        """Return `time.monotonic_ns()` [ns]."""
        return time.monotonic_ns()

    @staticmethod
    def sleep_until(deadline: int) -> None:
        """Sleep until `deadline` [ns], never returning before it."""
        while (remaining := deadline - time.monotonic_ns()) > 0:
            time.sleep(remaining * 1e-9)


class ScaledClock:
    """Another clock, faster or slower, that agrees with it at the moment it is made.

    Args:
        clock: the clock.
        speed: how fast this one goes in comparison, above 0.
    """

    def __init__(self, clock: Clock, speed: float) -> None:
        self._clock = clock
        self._speed = speed
        self._start = clock.now()

    def now(self) -> int:
        """Return the scaled time [ns]."""
        return self._start + int((self._clock.now() - self._start) * self._speed)

    def sleep_until(self, deadline: int) -> None:
        """Sleep until `deadline` [ns] of the scaled time, never returning before it."""
        while self.now() < deadline:
            remaining = math.ceil((deadline - self.now()) / self._speed)
            self._clock.sleep_until(self._clock.now() + remaining)


class VirtualClock:
    """A clock that stands still until somebody waits on it, and then jumps.

    Args:
        start: first value of `now()` [ns].
    """

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        """Return the virtual time [ns]."""
        return self._now

    def sleep_until(self, deadline: int) -> None:
        """Jump to `deadline` [ns]; a deadline in the past leaves the time as it is."""
        self._now = max(self._now, deadline)

    def advance(self, duration: int) -> None:
        """Let `duration` [ns] pass, as work does on a real clock.

        Raises:
            ValueError: the duration is negative.
        """
        if duration < 0:
            raise ValueError(
                f"a clock cannot go back: advance by {duration} ns; 0 or more is right"
            )
        self._now += duration


# The policy of a paced loop: requests to the operating system, and reaction to overruns.


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
