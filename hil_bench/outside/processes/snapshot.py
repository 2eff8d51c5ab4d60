"""A snapshot of the running bench for another process, such as the status line.

The writer never waits: it copies a row with a check sum into shared memory. A reader that meets a
row half written sees that the sum is wrong and reads again, whatever order the machine's caches
deliver stores in, and even if the writer was killed in the middle.

The memory has no name in the file system (`multiprocessing.RawArray`), so nothing is left behind
however either process ends. Hand the `Snapshot` to the reader as an argument of its `Process`.
"""

import ctypes
import multiprocessing
import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

_CHECK_SUM = struct.Struct("<I")
_ATTEMPTS = 100


class SnapshotRow(NamedTuple):
    """One row as the reader sees it.

    Attributes:
        sequence: number of the row, from 1; a higher number is a newer row.
        values: as many values as it is wide.
    """

    sequence: int
    values: tuple[float, ...]


class Snapshot:
    """The newest row of values, shared between one writer and any readers.

    Args:
        width: values of a row.
    """

    def __init__(self, width: int) -> None:
        self._format = f"<Q{width}d"
        self._size = struct.calcsize(self._format)
        self._memory = multiprocessing.RawArray(ctypes.c_char, self._size + _CHECK_SUM.size)
        self._sequence = 0

    def write(self, values: Sequence[float]) -> None:
        """Publish one row: as many values as it is wide."""
        self._sequence += 1
        row = struct.pack(self._format, self._sequence, *values)
        self._memory.raw = row + _CHECK_SUM.pack(zlib.crc32(row))

    def read(self) -> SnapshotRow | None:
        """Return the newest row, or None where there is none yet."""
        for _ in range(_ATTEMPTS):
            memory = self._memory.raw
            row, check_sum = memory[: self._size], memory[self._size :]
            if check_sum == _CHECK_SUM.pack(zlib.crc32(row)):
                sequence, *values = struct.unpack(self._format, row)
                return SnapshotRow(sequence, tuple(values))
        return None
