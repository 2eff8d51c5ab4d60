"""When faults begin and end."""

from collections import deque
from itertools import takewhile
from typing import NamedTuple

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.devices.faults.checks import to_ns
from hil_bench.devices.faults.fault import Effect, Fault

_KEPT_EVENTS = 1000


class FaultEvent(NamedTuple):
    """A fault began or ended.

    Attributes:
        time: bench time [ns].
        kind: of the fault.
        target: of the fault.
        is_begin: whether it began.
    """

    time: int
    kind: str
    target: str
    is_begin: bool


class FaultSchedule:
    """The faults that are there or are to come; past ones are in `events` only.

    Attributes:
        due: when `advance` has something to do [ns]: in each tick while a fault is there, since
            somebody may clear it after any of them, which is then its end.
        events: what began and ended last, oldest first.
    """

    def __init__(self) -> None:
        self.due = NEVER
        self.events: deque[FaultEvent] = deque(maxlen=_KEPT_EVENTS)
        self._now = 0
        self._faults: list[Fault] = []

    @property
    def active(self) -> tuple[Fault, ...]:
        """The faults that are active."""
        return tuple(fault for fault in self._faults if fault.is_active)

    def events_since(self, last: FaultEvent | None) -> list[FaultEvent]:
        """Return the events after `last`, oldest first; all that are kept where it is None."""
        newest = takewhile(lambda event: event is not last, reversed(self.events))
        return list(newest)[::-1]

    def advance(self, now: int) -> None:
        """Begin and end the faults that are due at `now` [ns]."""
        self._now = now
        for fault in self.active:
            if fault.ends is not None and fault.ends <= now:
                self._end(fault)
        for fault in self._faults:
            if not fault.is_active and (fault.begins is None or fault.begins <= now):
                self._begin(fault)
        self._set_due()

    def clear(self, fault: Fault | None = None) -> None:
        """End one fault, or all, those that are to come included."""
        for each in list(self._faults) if fault is None else [fault]:
            if each in self._faults:
                self._end(each)
        self._set_due()

    def add(
        self,
        kind: str,
        target: str,
        effect: Effect,
        at: float | None = None,
        duration: float | None = None,
    ) -> Fault:
        """Add a fault, which begins by itself, and return it.

        Args:
            kind: its name.
            target: of the fault.
            effect: of the fault.
            at: bench time at which it begins [s]; None for the next tick.
            duration: how long it lasts [s]; 0 for one tick, None until it is cleared.
        """
        fault = Fault(
            kind,
            target,
            effect,
            begins=None if at is None else to_ns("at", at),
            duration=None if duration is None else to_ns("duration", duration),
            clear=self.clear,
        )
        self._faults.append(fault)
        self._set_due()
        return fault

    def _begin(self, fault: Fault) -> None:
        if fault.begins is None:
            fault.begins = self._now
        fault.effect.begin(self._now)
        fault.is_active = True
        self.events.append(FaultEvent(self._now, fault.kind, fault.target, is_begin=True))

    def _end(self, fault: Fault) -> None:
        self._faults.remove(fault)
        if fault.is_active:
            fault.is_active = False
            fault.effect.end(self._now)
            self.events.append(FaultEvent(self._now, fault.kind, fault.target, is_begin=False))

    def _set_due(self) -> None:
        times = [0 if fault.is_active else fault.begins or 0 for fault in self._faults]
        self.due = min(times, default=NEVER)
