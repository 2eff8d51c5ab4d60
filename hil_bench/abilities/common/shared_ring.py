"""A ring of messages in shared memory, between two processes, and frames as such messages."""

import ctypes
import multiprocessing
import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter

from hil_bench.canopen_device.frame import Frame

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


# Frames as messages, from the loop to the recorder and to the feed.

_HEAD = "<qIBBB"  # time [ns], identifier, bus, flags, length; the data follow
_CLASSICAL, _FD = struct.Struct(f"{_HEAD}8s"), struct.Struct(f"{_HEAD}64s")
_EXTENDED, _REMOTE, _RECEIVED = 1, 2, 4
_by_fd = itemgetter(Frame._fields.index("fd"))

MOST_FRAMES = 256
"""Frames of a message."""


def pack_frames(frames: Sequence[Frame], now: int, *, is_received: bool) -> Iterator[bytes]:
    """Yield frames as messages, each of frames with the same `Frame.fd`, which is its first byte.

    Args:
        frames: the frames.
        now: their time [ns].
        is_received: whether the bench received them; it sent them otherwise.

    Yields:
        Up to `MOST_FRAMES` of them.
    """
    direction = _RECEIVED if is_received else 0
    for fd, group in groupby(frames, _by_fd):
        run, pack = list(group), (_FD if fd else _CLASSICAL).pack
        for first in range(0, len(run), MOST_FRAMES):
            yield bytes((fd,)) + b"".join(
                pack(now, can_id, bus, is_extended + (is_remote << 1) + direction, len(data), data)
                for can_id, data, is_remote, is_extended, bus, _ in run[first : first + MOST_FRAMES]
            )


def unpack_frames(message: bytes) -> Iterator[tuple[Frame, int, bool]]:
    """Yield each frame of a message, its time [ns] and whether the bench received it.

    Yields:
        The frames of `pack_frames`.
    """
    fd = message[0]
    records = (_FD if fd else _CLASSICAL).iter_unpack(memoryview(message)[1:])
    for time, can_id, bus, flags, length, data in records:
        is_remote, is_extended = bool(flags & _REMOTE), bool(flags & _EXTENDED)
        frame = Frame(can_id, data[:length], is_remote, is_extended, bus, fd)
        yield frame, time, bool(flags & _RECEIVED)
