"""Arbitration among waiting frames (ISO 11898-1: the lowest identifier wins)."""

import heapq

from hil_bench.abilities.copper.wire.station import Station
from hil_bench.canopen_device.agenda import NEVER

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
