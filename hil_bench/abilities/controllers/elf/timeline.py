"""The time of a chip: what is due when, and what a peripheral may ask of it."""

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from typing import Protocol


class Alarm:
    """Something that is due at a time, unless it is cancelled.

    Args:
        time: when [ns].
        action: is called then.

    Attributes:
        time: as passed in.
        is_on: False once it was cancelled or is over.
    """

    __slots__ = ("action", "is_on", "time")

    def __init__(self, time: int, action: Callable[[], None]) -> None:
        self.time, self.action = time, action
        self.is_on = True

    def cancel(self) -> None:
        """Have nothing happen then."""
        self.is_on = False


class Timeline:
    """All that is due, in order of time."""

    def __init__(self) -> None:
        self._due: list[tuple[int, int, Alarm]] = []
        self._numbers = count()

    def add(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns]."""
        alarm = Alarm(time, action)
        heappush(self._due, (time, next(self._numbers), alarm))
        return alarm

    def next_time(self, end: int) -> int:
        """Return the time of what is due next [ns], at most `end`."""
        due = self._due
        while due and not due[0][2].is_on:
            heappop(due)
        return due[0][0] if due and due[0][0] < end else end

    def fire(self, now: int) -> None:
        """Do what is due by now [ns]."""
        due = self._due
        while due and due[0][0] <= now:
            alarm = heappop(due)[2]
            if alarm.is_on:
                alarm.is_on = False
                alarm.action()

    def clear(self) -> None:
        """Forget everything."""
        self._due.clear()


class Core(Protocol):
    """The core, as its peripherals see it."""

    def now(self) -> int:
        """Return the chip's time, to the instruction [ns]."""

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns], though a program is running."""

    def pend(self, exception: int) -> None:
        """Make an exception pending."""

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        """Set the level of an interrupt's line: pending again for as long as it is active."""
