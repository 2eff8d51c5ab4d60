"""One bus of copper: arbitration, lengths to the bit, errors and what they lead to (ISO 11898-1).

Frames wait in the buffers of stations. Whenever the bus is free, all stations with a frame take
part in the arbitration; the lowest identifier wins, and nothing interrupts it. A frame that fails
is repeated at once. No thread and no clock: times come in, in nanoseconds, and never run back.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final, NamedTuple

from hil_bench.abilities.copper.wire.arbitration import Absence, Arbitration, dominant_errors
from hil_bench.abilities.copper.wire.attempt import (
    AFTER_FLAGS,
    FLAG,
    Attempt,
    Broken,
    Chance,
    Disturbances,
    ErrorKind,
)
from hil_bench.abilities.copper.wire.station import BUS_OFF_FROM, Station
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame

_NS_PER_S: Final = 1_000_000_000

SUSPENDED: Final = 8
"""Bits that an error-passive station waits after its own transmission, behind the intermission."""

_FAILED: Final = 8
_OWN_FAULT: Final = 9  # 1 for the error, 8 for a dominant bit behind its own flag


class Passage(NamedTuple):
    """A frame that has been on the bus.

    Attributes:
        frame: the frame.
        station: who sent it.
        released: when that one wanted to send it [ns].
        begin: when its first bit was on the bus [ns].
        end: when the bus was free again, after the intermission [ns].
        deaf: who could not read it.
    """

    frame: Frame
    station: Station
    released: int
    begin: int
    end: int
    deaf: frozenset[Station]


class ErrorFrame(NamedTuple):
    """An error that broke a transmission.

    Attributes:
        broken: what was wrong, and where.
        frame: the frame that failed.
        station: who sent it.
        begin: when its first bit was on the bus [ns].
        end: when the bus was free again [ns].
    """

    broken: Broken
    frame: Frame
    station: Station
    begin: int
    end: int


class Wire:
    """A bus.

    Args:
        bitrate: of the bus [bit/s].
        stations: all of them.
        chance: of disturbed bits; None for none.
        recovery: time from bus-off until the software of a station asks for its recovery [ns].
        data_bitrate: of the data phase of CAN FD [bit/s]; None for that of the rest.

    Attributes:
        bitrate: as passed in.
        due: when something happens next [ns]; a begin may give way to what is put before it.
        passed: frames that have passed.
        failed: transmissions that failed.
        on_error: is told each error.
        on_event: is told what happens to a station.
    """

    def __init__(
        self,
        bitrate: int,
        stations: Iterable[Station] = (),
        *,
        chance: Chance | None = None,
        recovery: int = 0,
        data_bitrate: int | None = None,
    ) -> None:
        self.bitrate = bitrate
        self._data_bitrate = data_bitrate or bitrate
        self.due = NEVER
        self.passed = 0
        self.failed = 0
        self.on_error: Callable[[ErrorFrame], None] | None = None
        self.on_event: Callable[[Station, CanEvent], None] | None = None
        self.stations: list[Station] = []
        self._waiting = Arbitration()
        self._disturbances = Disturbances(chance)
        self._last_put = 0
        self._free_at = 0
        self._going: Attempt | None = None
        self._begun = 0
        self._deaf: frozenset[Station] = frozenset()
        self._absent: set[Station] = set()
        self._listeners: list[Station] = []
        self._shaken: dict[Station, None] = {}  # in the order in which they were
        self._ruled: list[Station] = []
        self._suspended_until = 0
        self._recovery = recovery
        self._off: dict[Station, Absence] = {}
        self._stuck_since: int | None = None
        self._sticking = 0
        self._stuck_sender: Station | None = None
        self._stuck_counts: dict[Station, tuple[int, int]] = {}
        for station in stations:
            self.join(station, 0)

    @property
    def free_at(self) -> int:
        """When the bus is free again, or has been since [ns]."""
        return self._free_at

    def bits(self, count: int) -> int:
        """Return the time of some bits [ns]."""
        return count * _NS_PER_S // self.bitrate

    def _time(self, attempt: Attempt) -> int:
        """Return the time of a transmission [ns]."""
        if not attempt.fast:
            return self.bits(attempt.length)
        slow = attempt.length - attempt.fast
        both = slow * self._data_bitrate + attempt.fast * self.bitrate
        return both * _NS_PER_S // (self.bitrate * self._data_bitrate)

    def put(self, station: Station, frame: Frame, now: int) -> bool:
        """Have a station want to send a frame from now on [ns]; return whether none is lost."""
        head = station.head
        has_room = station.put(frame, now)
        if not has_room and not station.has_overrun:
            station.has_overrun = True
            self._tell(station, CanEvent.OVERRUN)
        self._last_put = now
        if station.head is not head and not station.is_off:
            self._waiting.enter(station)
            if self._going is None and self._stuck_since is None:
                self.due = min(self.due, max(self._free_at, now, station.ready_at))
        return has_room

    def run(self, until: int) -> list[Passage]:
        """Return the frames that have passed by a time [ns], in their order."""
        passages = []
        while (passage := self.advance(until)) is not None:
            passages.append(passage)
        return passages

    def advance(self, until: int) -> Passage | None:
        """Let time pass until the next frame has passed; None where none has until then [ns].

        A transmission that would begin at `until` itself does not: others may want to take part.
        """
        while self.can_step(until):
            passage = self.step()
            if passage is not None:
                return passage
        self.look(until)
        return None

    def can_step(self, until: int) -> bool:
        """Return True if something happens by a time [ns]."""
        return self.due < until or (self.due == until and self._going is not None)

    def step(self) -> Passage | None:
        """Let the next thing happen, which is due; return the frame that has passed by it."""
        if self._going is not None:
            return self._end(self._going)
        self._begin(self.due)
        return None

    def look(self, now: int) -> None:
        """Count the errors of a bus that is stuck, up to now [ns]."""
        if self._stuck_since is not None:
            self._count_stuck(now)

    # Who is there

    def make_end(self) -> "Wire":
        """Return a wire of its own for a station whose plug is pulled."""
        end = Wire(self.bitrate, recovery=self._recovery, data_bitrate=self._data_bitrate)
        end.on_event = self.on_event
        return end

    def join(self, station: Station, now: int) -> None:
        """Have a station take part from now on [ns]."""
        if station not in self.stations:
            self.stations.append(station)
        self._absent.discard(station)
        if station.is_off:
            self._off[station] = Absence(now)
        self._take_stock()
        self._waiting.enter(station)
        if self._going is None:
            self._free_at = max(self._free_at, now)
            self._search()

    def leave(self, station: Station, now: int) -> None:
        """Have a station take part no more; what it sends is cut off, and goes back."""
        if self._going is not None and station in self._going.senders:
            self.break_off(now)
        self.stations.remove(station)
        self._absent.add(station)
        self._off.pop(station, None)
        self._shaken.pop(station, None)
        self._waiting.remove(station)
        self._take_stock()
        if self._going is None:
            self._schedule()

    def watch_rules(self) -> None:
        """Take note that the rules of some station have changed."""
        self._ruled = [each for each in self.stations if each.receive_rules]

    def _take_stock(self) -> None:
        self._listeners = [each for each in self.stations if not each.is_off]
        self._deaf = frozenset((*(each for each in self.stations if each.is_off), *self._absent))
        if len(self._listeners) > 1:
            for station in self._listeners:
                if station.ready_at == NEVER:
                    station.ready_at = 0
        self.watch_rules()

    # Begins

    def _schedule(self) -> None:
        """Find when the next transmission begins, or the next station recovers."""
        free_at = self._free_at
        is_known = free_at >= self._last_put and free_at >= self._suspended_until
        if self._waiting and self._stuck_since is None and is_known:
            self.due = free_at  # at the latest then: `_begin` looks again
        else:
            self._search()

    def _search(self) -> None:
        """As `_schedule`, by looking at all stations that wait."""
        if self._stuck_since is not None:
            self.due = NEVER
            return
        due = self._waiting.earliest(self._free_at)
        for station, absence in self._off.items():
            if not station.held_off:
                due = min(due, absence.back_at(self._free_at, self.bits))
        self.due = due

    def _begin(self, now: int) -> None:
        """Have the winner of the arbitration send; where nobody can, look when somebody will."""
        if self._off:
            self._recover(now)
        senders = self._waiting.decide(now)
        if not senders:
            self._search()
            return
        self._going = self._disturbances.attempt(
            senders, self._listeners, has_rules=bool(self._ruled)
        )
        self._begun = now
        self.due = now + self._time(self._going)

    # Ends

    def _end(self, attempt: Attempt) -> Passage | None:
        """Count what has passed or failed; return it where it has passed."""
        self._going = None
        begin, end = self._begun, self._begun + self._time(attempt)
        self._free_at = end
        for absence in self._off.values():
            absence.see(begin, end, self.bits)
        released = attempt.senders[0].released
        if attempt.broken is None:
            self._pass(attempt)
        else:
            self._fail(attempt, attempt.broken)
        for station in attempt.senders:
            if not station.is_off:
                if station.ready_at != NEVER and station.is_passive:
                    station.ready_at = end + self.bits(SUSPENDED)
                    self._suspended_until = station.ready_at
                self._waiting.enter(station)
        self._schedule()
        if attempt.broken is not None:
            return None
        deaf = self._deaf | frozenset(attempt.deaf) if attempt.deaf else self._deaf
        frame, station = attempt.frames[0], attempt.senders[0]
        return Passage(frame, station, released, begin, end, deaf)

    def _pass(self, attempt: Attempt) -> None:
        first = attempt.senders[0]
        self.passed += 1
        for station, frame in zip(attempt.senders, attempt.frames, strict=True):
            if frame != attempt.frames[0]:
                self._count(station, partial(station.fail, _FAILED))
            elif station.tec:
                self._count(station, station.succeed)
            else:
                station.succeed()
        for station in [*self._shaken] if self._shaken else ():
            if station not in attempt.senders and station not in attempt.deaf:
                self._count(station, station.receive)
        for station in attempt.deaf:
            station.missed += 1
            self._count(station, partial(station.fail_to_receive, 1))
        if first.has_overrun and not first.waiting:
            first.has_overrun = False
            self._tell(first, CanEvent.SENT_ALL)

    def _fail(self, attempt: Attempt, broken: Broken) -> None:
        self.failed += 1
        for station in self._listeners.copy():
            if station not in attempt.senders:
                errors = _OWN_FAULT if station is attempt.culprit else 1
                self._count(station, partial(station.fail_to_receive, errors))
        for station in attempt.senders:
            # An error-passive station that nobody acknowledges stays what it is (exception 1).
            is_alone = broken.kind is ErrorKind.ACK and station.is_passive
            if is_alone:  # and repeats it for ever, which changes nothing until somebody is there
                station.ready_at = NEVER
            self._count(station, partial(station.fail, 0 if is_alone else _FAILED))
        self._report(broken, attempt, self._free_at)

    def _report(self, broken: Broken, attempt: Attempt, end: int) -> None:
        if self.on_error is not None:
            first, frame = attempt.senders[0], attempt.frames[0]
            self.on_error(ErrorFrame(broken, frame, first, self._begun, end))

    def break_off(self, now: int) -> None:
        """Cut off what is on the bus: its sender is gone."""
        attempt = self._going
        if attempt is None:
            return
        self._going = None
        sent = (now - self._begun) * self.bitrate // _NS_PER_S
        broken = Broken(ErrorKind.STUFF, sent, sent + 2 * FLAG + AFTER_FLAGS)
        self._free_at = self._begun + self.bits(broken.length)
        self.failed += 1
        for station in attempt.senders:
            station.take_back()
            self._waiting.enter(station)
        for station in self._listeners.copy():
            if station not in attempt.senders:
                self._count(station, partial(station.fail_to_receive, 1))
        self._report(broken, attempt, self._free_at)
        self._schedule()

    # Counters and states

    def _count(self, station: Station, change: Callable[[], None]) -> None:
        """Change the counters of a station, and tell what that leads to."""
        was_passive = station.is_passive
        change()
        if station.tec or station.rec:
            self._shaken[station] = None
        else:
            self._shaken.pop(station, None)
        if station.tec >= BUS_OFF_FROM and not station.is_off:
            self.switch_off(station)
        elif station.is_passive != was_passive and not station.is_off:
            self._tell(station, CanEvent.PASSIVE if station.is_passive else CanEvent.ACTIVE)

    def switch_off(self, station: Station) -> None:
        """Make a station bus-off."""
        station.is_off = True
        asked_at = self._free_at + self._recovery
        self._off[station] = Absence(asked_at)
        self._shaken.pop(station, None)
        self._take_stock()
        self._tell(station, CanEvent.BUS_OFF)

    def force_off(self, station: Station, now: int) -> None:
        """Make a station bus-off until `let_recover` [ns]."""
        station.held_off += 1
        self._free_at = max(self._free_at, now) if self._going is None else self._free_at
        if not station.is_off:
            if self._going is not None and station in self._going.senders:
                self.break_off(now)
            station.tec = BUS_OFF_FROM
            self.switch_off(station)

    def let_recover(self, station: Station, now: int) -> None:
        """Let a station that was made bus-off recover from now on [ns]."""
        station.held_off -= 1
        if not station.held_off and station.is_off:
            self._off[station] = Absence(now)
            if self._going is None:
                self._schedule()

    def _recover(self, now: int) -> None:
        for station, absence in [*self._off.items()]:
            if station.held_off or absence.back_at(self._free_at, self.bits) > now:
                continue
            del self._off[station]
            station.is_off = False
            station.tec = station.rec = 0
            self._take_stock()
            self._waiting.enter(station)
            self._tell(station, CanEvent.RECOVERED)

    def _tell(self, station: Station, event: CanEvent) -> None:
        if self.on_event is not None:
            self.on_event(station, event)

    # Stuck dominant

    def stick(self, now: int) -> None:
        """Let the bus be dominant from now on [ns]."""
        self._sticking += 1
        if self._stuck_since is not None:
            return
        self._stuck_since = now
        attempt, self._going = self._going, None
        self._stuck_sender = attempt.senders[0] if attempt else None
        for station in attempt.senders if attempt else ():
            station.take_back()
            self._waiting.enter(station)
        if attempt is not None:
            self.failed += 1
            sent = (now - self._begun) * self.bitrate // _NS_PER_S
            self._report(Broken(ErrorKind.DOMINANT, sent, sent), attempt, now)
        self._stuck_counts = {each: (each.tec, each.rec) for each in self._listeners}
        self.due = NEVER

    def unstick(self, now: int) -> None:
        """Let the bus be free again; eight recessive bits and the intermission come first."""
        self._sticking -= 1
        if self._stuck_since is None or self._sticking:
            return
        self._count_stuck(now)
        self._stuck_since = None
        self._free_at = now + self.bits(AFTER_FLAGS)
        for absence in self._off.values():
            absence.begin_anew(now)
        self._schedule()

    def _count_stuck(self, now: int) -> None:
        """Count errors of a dominant bus (ISO 11898-1, rules a, b, d and f)."""
        bits = (now - (self._stuck_since or 0)) * self.bitrate // _NS_PER_S
        for station, (tec, rec) in self._stuck_counts.items():
            if station.is_off:
                continue
            if station is self._stuck_sender:
                errors = tec + dominant_errors(bits, is_sender=True)
                self._count(station, partial(station.count_to, errors, station.rec))
            else:
                errors = rec + dominant_errors(bits, is_sender=False)
                self._count(station, partial(station.count_to, station.tec, errors))
