"""Nodes that fall silent, by their heartbeats and their frames."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Final

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, more, seconds
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import Way
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import RESTORED, NmtRequest
from hil_bench.canopen_device.sync import SYNC_COB_ID

# Times in which nothing at all was on the bus, though several senders were due.


_SHORTEST: Final = 250_000_000
"""Time without a frame from which on the senders that are due are counted [ns]."""

_REGULAR: Final = 5
_REGULAR_BEATS: Final = 3
"""Intervals alike after which a sender has a period, and after which a heartbeat has its."""

_DUE: Final = 2.2
"""Periods after which one is late."""

_ALIVE: Final = 2
"""Periods before the silence in which one was heard last."""

_SENDERS: Final = 2
_COMMANDED: Final = 300_000_000
"""Time after an NMT command in which senders stop because they shall [ns]."""

_MOST: Final = 4096
_SENDER_OF_FD: Final = -1 - 0x100


@dataclass(slots=True)
class _Rhythm:
    """The period of one identifier."""

    last: int
    sender: int
    is_heartbeat: bool
    is_sync: bool
    period: float = 0.0
    alike: int = 0


class Silence:
    """Follows the periods of all identifiers, and finds the times in which all stayed out.

    Attributes:
        gaps: how often that was.
    """

    def __init__(self) -> None:
        self.gaps = 0
        self._rhythms: dict[int, _Rhythm] = {}
        self._last = 0
        self._commanded = -_COMMANDED
        self._first: tuple[int, int, int] | None = None

    def take(self, frame: Frame, now: int) -> int:
        """Follow a frame; return how long the bus was silent before it [ns], 0 for not at all."""
        gap, self._last = now - self._last, now
        silent = 0
        if gap > _SHORTEST and (senders := self._due(now, gap)):
            is_boot = frame.can_id & 0x780 == 0x700 and frame.data == b"\0"
            if not is_boot or frame.is_extended or frame.fd:
                self.gaps += 1
                self._first = self._first or (now - gap, gap, senders)
                silent = gap
                for each in self._rhythms.values():
                    each.last += gap
        if frame.can_id == 0 and not frame.is_extended and not frame.fd:
            self._commanded = now
        key = -1 - frame.can_id if frame.fd else frame.can_id
        rhythm = self._rhythms.get(key)
        if rhythm is None:
            if len(self._rhythms) < _MOST:
                self._rhythms[key] = _new(frame, now)
            return silent
        interval, rhythm.last = now - rhythm.last, now
        period = rhythm.period
        if 0.5 * period <= interval <= 1.6 * period:
            rhythm.alike += 1
            rhythm.period = period + (interval - period) / 8
        else:
            rhythm.alike, rhythm.period = 0, interval
        return silent

    def skip(self, length: int) -> None:
        """Take note that the clock has leapt [ns]."""
        self._last += length
        for each in self._rhythms.values():
            each.last += length

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield that the bus was silent.

        Args:
            end: of the log [ns].

        Yields:
            At most one finding.
        """
        first, gaps = self._first, self.gaps
        gap = end - self._last
        if gap > _SHORTEST and (senders := self._due(end, gap)):
            first, gaps = first or (self._last, gap, senders), gaps + 1
        if first is not None:
            since, gap, senders = first
            text = f"nothing is on the bus for {milliseconds(gap)} after {seconds(since)}, of "
            text += f"{senders} senders that were due"
            text += more(gaps)
            yield Finding(Cause.BUS_SILENT, "", since, text)

    def _due(self, now: int, gap: int) -> int:
        """Return the number of senders that are late together; 0 if they were to stop."""
        begin = now - gap
        if begin - self._commanded < _COMMANDED:
            return 0
        late = [
            each
            for each in self._rhythms.values()
            if each.alike >= (_REGULAR_BEATS if each.is_heartbeat else _REGULAR)
            and begin - each.last < _ALIVE * each.period
            and now - each.last > _DUE * each.period
        ]
        senders = {each.sender for each in late}
        if any(each.is_sync for each in late) and not any(each.is_heartbeat for each in late):
            return 0  # those that follow SYNC stop with it
        return len(senders) if len(senders) >= _SENDERS else 0


def _new(frame: Frame, now: int) -> _Rhythm:
    if frame.fd:  # nobody knows whose it is, so all of them are one sender's
        return _Rhythm(now, _SENDER_OF_FD, is_heartbeat=False, is_sync=False)
    if frame.is_extended:
        return _Rhythm(now, -1 - (frame.can_id & 0xFF), is_heartbeat=False, is_sync=False)
    is_heartbeat = 0x700 < frame.can_id < 0x780
    return _Rhythm(now, frame.can_id & 0x7F, is_heartbeat, frame.can_id == SYNC_COB_ID)


# Heartbeats that stay out, and who noticed.


LATE = 2.5
"""Periods after which a heartbeat counts as lost."""

_FEWEST = 4
_NOTICE = 5_000_000_000
_KEPT = 64
_HEARTBEAT_EMCY = 0x8130
_NS_PER_MS = 1_000_000


@dataclass(slots=True)
class _Pulse:
    """The heartbeat of one node.

    Attributes:
        last: the last one; None where the next begins anew.
        due_from: when the next one's time began [ns].
        intervals: the last ones [ns].
        gap: the first time that it stayed out: the beats before and behind, and its period [ns].
        gaps: how often it stayed out.
    """

    last: Sight | None = None
    due_from: int = 0
    intervals: deque[int] = field(default_factory=lambda: deque(maxlen=15))
    gap: tuple[Sight, Sight | None, float] | None = None
    gaps: int = 0


class Heartbeats:
    """Watches the period of each heartbeat: that of 0x1017, or else the usual one.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.NMT, Service.EMCY, Service.SDO, Service.HEARTBEAT})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._pulses: dict[tuple[int, int], _Pulse] = {}
        self._emergencies: deque[Sight] = deque(maxlen=_KEPT)

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.NMT:
            self._hear_command(sight)
        elif sight.emcy_code == _HEARTBEAT_EMCY:
            self._emergencies.append(sight)
        elif sight.service is Service.SDO and sight.transfer is not None:
            is_set = sight.transfer.index == 0x1017 and sight.transfer.way is Way.DOWNLOAD
            if is_set and sight.node_id is not None:
                self._forget(sight.frame.bus, sight.node_id)
        elif sight.service is Service.HEARTBEAT and sight.node_id is not None:
            self._hear_pulse(sight, sight.node_id)

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the nodes whose heartbeat stayed out.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for key, pulse in self._pulses.items():
            period = self._period(key, pulse)
            gap, gaps = pulse.gap, pulse.gaps
            if pulse.last is not None and period and end - pulse.due_from > LATE * period:
                gap, gaps = gap or (pulse.last, None, period), gaps + 1
            if gap is not None:
                yield self._tell(gap, gaps)

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        for pulse in self._pulses.values():
            pulse.due_from += length

    def _hear_command(self, sight: Sight) -> None:
        request = NmtRequest.parse(sight.frame.data)
        if request is not None and request.command in RESTORED:
            for bus, node_id in list(self._pulses):
                if bus == sight.frame.bus and request.addresses(node_id):
                    self._forget(bus, node_id)

    def _forget(self, bus: int, node_id: int) -> None:
        pulse = self._pulses.setdefault((bus, node_id), _Pulse())
        pulse.last = None
        pulse.intervals.clear()

    def _hear_pulse(self, sight: Sight, node_id: int) -> None:
        key = sight.frame.bus, node_id
        if sight.name == "boot-up":
            self._forget(*key)
            return
        if sight.frame.is_remote or len(sight.frame.data) != 1:
            return
        pulse = self._pulses.setdefault(key, _Pulse())
        if pulse.last is not None:
            interval, period = sight.now - pulse.due_from, self._period(key, pulse)
            if period and interval > LATE * period:
                pulse.gap = pulse.gap or (pulse.last, sight, period)
                pulse.gaps += 1
            else:
                pulse.intervals.append(interval)
        pulse.last, pulse.due_from = sight, sight.now

    def _period(self, key: tuple[int, int], pulse: _Pulse) -> float:
        """Return the period of a heartbeat [ns]; 0 where it has none that is known."""
        node = self._decoder.nodes.get(key)
        if node is not None and node.objects.find(0x1017) is not None:
            own = node.number(0x1017) * _NS_PER_MS
            if own or node.has_eds is False:
                return own
        return median(pulse.intervals) if len(pulse.intervals) >= _FEWEST else 0.0

    def _tell(self, gap: tuple[Sight, Sight | None, float], gaps: int) -> Finding:
        last, next_one, period = gap
        every = milliseconds(period)
        text = f"{last.node}: no heartbeat after {seconds(last.now)} (every {every} before)"
        if next_one is None:
            text += ", and none until the end"
        else:
            text += f", for {milliseconds(next_one.now - last.now)}"
        text += more(gaps)
        noticed = [
            emcy
            for emcy in self._emergencies
            if 0 <= emcy.now - last.now < _NOTICE and emcy.node != last.node
        ]
        if noticed:
            text += f"; {noticed[0].node} reports it at {seconds(noticed[0].now)}"
        sights = [last, *noticed[:1], *([next_one] if next_one else [])]
        shown = tuple(sights)
        return Finding(Cause.HEARTBEAT_LOST, last.node, last.now, text, shown, span=round(period))
