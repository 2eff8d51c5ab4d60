"""Arbitration, and the way back from bus-off."""

import heapq
from collections.abc import Callable
from typing import Final

from hil_bench.abilities.copper.wire.attempt import FLAG
from hil_bench.abilities.copper.wire.station import Station
from hil_bench.canopen_device.agenda import NEVER

# Arbitration among waiting frames (ISO 11898-1: the lowest identifier wins).


_Entry = tuple[int, int, int, Station]
"""Priority, number of the entry, number of the frame in its buffer, and whose it is."""


class Arbitration:
    """The heads of the buffers of all stations, sorted.

    An entry whose frame is no longer the head of its station's buffer is passed over.
    """

    def __init__(self) -> None:
        self._heads: list[_Entry] = []
        self._inside: set[tuple[int, int]] = set()
        self._entered = 0

    def __bool__(self) -> bool:
        """Return True if a frame may wait."""
        return bool(self._heads)

    def enter(self, station: Station) -> None:
        """Have the head of a station's buffer take part."""
        head = station.head
        if head is not None and (id(station), head.number) not in self._inside:
            self._entered += 1
            self._inside.add((id(station), head.number))
            heapq.heappush(self._heads, (head.priority, self._entered, head.number, station))

    def remove(self, station: Station) -> None:
        """Have a station take part no more."""
        self._heads = [entry for entry in self._heads if entry[3] is not station]
        heapq.heapify(self._heads)
        self._inside = {(id(entry[3]), entry[2]) for entry in self._heads}

    def earliest(self, free_at: int) -> int:
        """Return when the first transmission can begin on a bus that is free [ns]."""
        due = NEVER
        for _, _, number, station in self._heads:
            head = station.head
            if head is not None and head.number == number and not station.is_off:
                due = min(due, max(head.released, station.ready_at, free_at))
        return due

    def decide(self, now: int) -> tuple[Station, ...]:
        """Return the senders at `now` [ns]: the winner, and stations with the same identifier."""
        heads = self._heads
        winner: _Entry | None = None
        rivals: list[Station] = []
        late: list[_Entry] = []
        while heads and (winner is None or heads[0][0] == winner[0]):
            entry = heapq.heappop(heads)
            station, head = entry[3], entry[3].head
            self._inside.discard((id(station), entry[2]))
            if head is None or head.number != entry[2] or station.is_off:
                continue
            if station.ready_at > now or head.released > now:
                late.append(entry)
            elif winner is None:
                winner = entry
            else:
                rivals.append(station)
        for entry in late:
            self._inside.add((id(entry[3]), entry[2]))
            heapq.heappush(heads, entry)
        return () if winner is None else (winner[3], *rivals)


# Error counters on a dominant bus, and the recovery of a station (ISO 11898-1).


SEQUENCES: Final = 128
SEQUENCE: Final = 11
"""A station that was bus-off is back after 128 sequences of 11 recessive bits."""

_TOLERATED: Final = 14
_MORE: Final = 8


class Absence:
    """Counts the recessive sequences that a station waits for which is bus-off.

    Args:
        asked_at: when its software asks for the recovery [ns].
    """

    __slots__ = ("asked_at", "left", "since")

    def __init__(self, asked_at: int) -> None:
        self.asked_at = asked_at
        self.since = asked_at
        self.left = SEQUENCES

    def back_at(self, free_at: int, bits: Callable[[int], int]) -> int:
        """Return when it is back if the bus stays idle [ns]."""
        return max(self.since, free_at) + bits(self.left * SEQUENCE)

    def see(self, begin: int, end: int, bits: Callable[[int], int]) -> None:
        """Take note of a transmission; idle bits before it, and 11 at its end, are recessive."""
        if end <= self.asked_at:
            return
        idle = max(0, begin - self.since)
        self.left = max(0, self.left - idle // bits(SEQUENCE) - 1)
        self.since = end

    def begin_anew(self, now: int) -> None:
        """Wait for all of them from now on [ns]: a dominant bus has none."""
        self.since = max(self.asked_at, now)


def dominant_errors(bits: int, *, is_sender: bool) -> int:
    """Return the increment of an error-active station's counter for dominant bits in a row.

    A sender notices at the first bit, a receiver at the sixth by the rule of stuffing. Six bits of
    the error flag follow; a dominant bit behind it counts 8 for a receiver, and so do for all the
    fourteenth from the begin of the flag, and each eighth after that.
    """
    if is_sender:
        begin, errors = 1, 8
    else:
        begin, errors = FLAG, 1
    if bits < begin:
        return 0
    since = bits - begin
    if since > FLAG and not is_sender:
        errors += 8
    if since >= _TOLERATED:
        errors += 8 * (1 + (since - _TOLERATED) // _MORE)
    return errors
