"""Shared memory between processes: a ring of records, and a snapshot of the last one."""

import ctypes
import multiprocessing
import struct
import sys
import zlib
from collections.abc import Iterator

# Messages from the loop to another process, through shared memory.
#
# One writer, one reader, no lock and no system call: the writer copies a message behind the last
# one and publishes the new end; where the reader is too far behind, the message is counted as
# lost and the loop goes on. Each message has a check sum, so that the reader sees the ones that
# are not all there yet, whatever order the machine's caches deliver stores in.
#
# The memory has no name in the file system (`multiprocessing.RawArray`). It outlives the writer
# for as long as the reader holds it: what a killed loop has written is still read.

_HEADER = struct.Struct("<III")  # check sum of the rest, kind, length
_END, _TAKEN = 0, 1  # indices into the counters
_COUNTERS_SIZE = 16
_SKIP = 0xFFFFFFFF  # kind of what fills the memory up to its end


class SharedRing:
    """A ring of messages; hand it to the reader as an argument of its `Process`.

    Args:
        capacity: bytes that it holds, filled up to a multiple of 8.

    Attributes:
        lost: messages for which there was no room; counted on the writer's side.
    """

    def __init__(self, capacity: int) -> None:
        self._size = -(-capacity // 8) * 8
        self._memory = multiprocessing.RawArray(ctypes.c_char, _COUNTERS_SIZE + self._size)
        self.lost = 0
        self._open()
        # Touched now, so that no page fault costs a tick later.
        self._data[:] = bytes(self._size)

    def __getstate__(self) -> dict[str, object]:
        return {"size": self._size, "memory": self._memory}

    def __setstate__(self, state: dict[str, object]) -> None:
        self._size = state["size"]  # type: ignore[assignment]
        self._memory = state["memory"]  # type: ignore[assignment]
        self.lost = 0
        self._open()

    def _open(self) -> None:
        view = memoryview(self._memory).cast("B")
        # Native 64-bit items: each is stored at once, never in two halves.
        self._counters = view[:_COUNTERS_SIZE].cast("Q")
        self._data = view[_COUNTERS_SIZE:]
        self._end = self._counters[_END]
        self._taken = self._counters[_TAKEN]

    def put(self, kind: int, message: bytes) -> bool:
        """Append a message; False where there is no room for it.

        Args:
            kind: what it is, a number of the user's.
            message: at most the ring's size.
        """
        size = (_HEADER.size + len(message) + 7) & ~7
        place = self._end % self._size
        to_end = self._size - place
        needed = size if size <= to_end else to_end + size
        if self._end + needed - self._taken > self._size:
            self._taken = self._counters[_TAKEN]
            if self._end + needed - self._taken > self._size:
                self.lost += 1
                return False
        if size > to_end:
            self._fill(place, to_end)
            place = 0
        length = len(message)
        check_sum = zlib.crc32(message, kind ^ length)
        start = place + _HEADER.size
        self._data[start : start + length] = message
        _HEADER.pack_into(self._data, place, check_sum, kind, length)
        self._end += needed
        self._counters[_END] = self._end
        return True

    def take(self, most: int = sys.maxsize) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of the messages that are there, oldest first.

        Args:
            most: of them; the others stay for the next time.
        """
        end = self._counters[_END]
        while self._taken < end and most > 0:
            place = self._taken % self._size
            to_end = self._size - place
            if to_end < _HEADER.size:
                self._taken += to_end
                continue
            check_sum, kind, length = _HEADER.unpack_from(self._data, place)
            if kind == _SKIP and check_sum == _SKIP:
                self._taken += to_end
                continue
            start = place + _HEADER.size
            message = bytes(self._data[start : start + length])
            if len(message) != length or zlib.crc32(message, kind ^ length) != check_sum:
                break  # not all there yet
            most -= 1
            yield kind, message
            self._taken += (_HEADER.size + length + 7) & ~7
        self._counters[_TAKEN] = self._taken

    def _fill(self, place: int, size: int) -> None:
        """Say that nothing more comes up to the end of the memory."""
        if size >= _HEADER.size:
            _HEADER.pack_into(self._data, place, _SKIP, _SKIP, 0)
