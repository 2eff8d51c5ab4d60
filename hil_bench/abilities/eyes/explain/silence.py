"""Times in which nothing at all was on the bus, though several senders were due."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, seconds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sync import SYNC_COB_ID

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
            text += f"; {gaps - 1} times more" if gaps > 1 else ""
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
