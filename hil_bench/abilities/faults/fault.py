"""A fault: its effect, when it is there, how to end it; and the schedule of all."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

from hil_bench.abilities.faults.checks import to_ns
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.errors import ConfigError


class Effect(Protocol):
    """The effect of a fault.

    One that may change nothing, such as a rule that meets no frame, says by `has_acted` whether it
    has changed something.
    """

    def begin(self, now: int, /) -> None:
        """Make it so, at `now` [ns]."""

    def end(self, now: int, /) -> None:
        """Take it back, at `now` [ns]."""


Clear = Callable[["Fault"], None]
"""Ends a fault."""


class Fault:
    """One fault of one target.

    It lasts until it is cleared or its duration is over, and at least one tick. As a context
    manager it is cleared at the end of the block.

    Attributes:
        kind: what goes wrong.
        target: with what: the name of a node or an axis.
        begins: bench time [ns]; None for the next tick.
        duration: how long it lasts [ns]; None until it is cleared.
        effect: what it does.
        is_active: whether it is there now.
    """

    def __init__(
        self,
        kind: str,
        target: str,
        effect: Effect,
        *,
        begins: int | None,
        duration: int | None,
        clear: Clear,
    ) -> None:
        self.kind = kind
        self.target = target
        self.begins = begins
        self.duration = duration
        self.effect = effect
        self.is_active = False
        self._clear = clear

    @property
    def ends(self) -> int | None:
        """When it ends by itself, in bench time [ns]; None where it does not, or has not begun."""
        if self.begins is None or self.duration is None:
            return None
        return self.begins + self.duration

    @property
    def is_idle(self) -> bool:
        """True if it has changed nothing so far."""
        return not getattr(self.effect, "has_acted", True)

    def clear(self) -> None:
        """End the fault, or see to it that it never begins; a second call does nothing."""
        self._clear(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def __repr__(self) -> str:
        """Return kind, target and state."""
        state = "active" if self.is_active else "not active"
        return f"<Fault {self.kind} {self.target}, {state}>"


@dataclass(frozen=True, slots=True)
class FaultConfig:
    """A fault that happens by itself.

    Attributes:
        kind: its name.
        target: with what.
        at: when, in bench time [s].
        duration: for how long [s]; None for ever.
        values: what the kind needs to know, by parameter of its verb, in SI.
        is_baseline: whether it was asked for with an amount that changes nothing.
    """

    kind: str
    target: str
    at: float
    duration: float | None
    values: Mapping[str, float | int | str]
    is_baseline: bool = False


# When faults begin and end.

NOTHING_CHANGED = ", and has changed nothing"

MOST_FAULTS = 256
"""Most faults that commands may have begun, or planned, at a time: each costs every tick."""

_KEPT_EVENTS = 1000


class FaultEvent(NamedTuple):
    """A fault began or ended.

    Attributes:
        time: bench time [ns].
        fault: the fault.
        is_begin: whether it began.
    """

    time: int
    fault: Fault
    is_begin: bool

    @property
    def kind(self) -> str:
        """The kind of the fault."""
        return self.fault.kind

    @property
    def verb(self) -> str:
        """The event in a verb: it begins or ends."""
        return "begins" if self.is_begin else f"ends{self.note}"

    @property
    def note(self) -> str:
        """That the fault has changed nothing so far, else empty."""
        return NOTHING_CHANGED * self.fault.is_idle

    @property
    def what(self) -> str:
        """The word "fault"."""
        return "fault"

    @property
    def name(self) -> str:
        """The kind and the target."""
        return f"{self.fault.kind} {self.fault.target}"

    @property
    def content(self) -> Mapping[str, object]:
        """The event for programs, without its time."""
        return {"kind": self.kind, "target": self.fault.target, "begins": self.is_begin}


class FaultSchedule:
    """The faults that are there or are to come; past ones are in `events` only.

    Attributes:
        due: when `advance` has something to do [ns]: in each tick while a fault is there, since
            somebody may clear it after any of them, which is then its end.
        events: what began and ended last, oldest first.
        kept: the faults that commands have begun, by their numbers.
    """

    def __init__(self) -> None:
        self.due = NEVER
        self.events: deque[FaultEvent] = deque(maxlen=_KEPT_EVENTS)
        self._now = 0
        self.kept: dict[int, Fault] = {}
        self._last_number = 0
        self._faults: list[Fault] = []
        self._idle: dict[str, None] = {}

    @property
    def active(self) -> tuple[Fault, ...]:
        """The faults that are active."""
        return tuple(fault for fault in self._faults if fault.is_active)

    @property
    def pending(self) -> tuple[Fault, ...]:
        """The faults that are to come."""
        return tuple(fault for fault in self._faults if not fault.is_active)

    @property
    def idle(self) -> tuple[str, ...]:
        """The faults that have begun and have changed nothing, those that have ended too."""
        now = {f"{each.kind} {each.target}": None for each in self.active if each.is_idle}
        return tuple(self._idle | now)

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

    def check_room(self, now: int) -> None:
        """Refuse that a command begins another one at `now` [ns].

        Raises:
            ConfigError: there are too many.
        """
        self._forget(now)
        if len(self.kept) >= MOST_FAULTS:
            raise ConfigError(f"fault: {MOST_FAULTS} are there or planned already; clear one")

    def number_of(self, fault: Fault, now: int) -> int:
        """Return the number of a fault; one that has none gets it at `now` [ns]."""
        for number, known in self.kept.items():
            if known is fault:
                return number
        self._forget(now)
        self._last_number += 1
        self.kept[self._last_number] = fault
        return self._last_number

    def _forget(self, now: int) -> None:
        """Forget the numbers of those that have ended by themselves."""
        self.kept = {
            number: known
            for number, known in self.kept.items()
            if known.is_active or known.begins is None or known.begins >= now
        }

    def _begin(self, fault: Fault) -> None:
        if fault.begins is None:
            fault.begins = self._now
        fault.effect.begin(self._now)
        fault.is_active = True
        self.events.append(FaultEvent(self._now, fault, is_begin=True))

    def _end(self, fault: Fault) -> None:
        self._faults.remove(fault)
        if fault.is_active:
            fault.is_active = False
            fault.effect.end(self._now)
            event = FaultEvent(self._now, fault, is_begin=False)
            self.events.append(event)
            if fault.is_idle:
                self._idle[event.name] = None

    def _set_due(self) -> None:
        times = [0 if fault.is_active else fault.begins or 0 for fault in self._faults]
        self.due = min(times, default=NEVER)
