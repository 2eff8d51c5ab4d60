"""The memory that the bench and a program share, as ``preload/bench.h`` lays it out."""

import mmap
import os
import struct
from collections.abc import Iterable, Sequence
from typing import Final

from hil_bench.abilities.controllers.seam import TimedFrame
from hil_bench.canopen_device.frame import Frame, make_frame

VERSION: Final = 1
RING: Final = 4096
"""Frames that wait at most, each way."""

NAME_SIZE: Final = 16

_RECORD: Final = struct.Struct("<qIBBxx8s")
_U32, _I64 = struct.Struct("<I"), struct.Struct("<q")
_VERSION, _GRANTED, _UNTIL, _IN_HEAD, _OUT_TAIL, _BUSES = 0, 4, 8, 16, 20, 24
_NAMES, _NOW, _WAKE, _IN_TAIL, _OUT_HEAD = 32, 288, 296, 304, 308
_ANSWERED, _STATE, _RANDOM, _REFUSAL = 312, 316, 324, 332
_REFUSAL_SIZE: Final = 172
_IN: Final = 504
_OUT: Final = _IN + RING * _RECORD.size
_SIZE: Final = _OUT + RING * _RECORD.size

_ATTACHED, _WATCHES_OTHERS = 1, 2
_EXTENDED, _REMOTE = 0x8000_0000, 0x4000_0000
_SEED: Final = 0x2545_F491  # any but 0


class Exchange:
    """The shared memory of a program.

    Args:
        names: of its buses, as network interfaces.
        now: bench time at which it begins [ns].
        is_real: whether it keeps the machine's clocks.

    Attributes:
        descriptor: of the memory.
    """

    def __init__(self, names: Sequence[str], now: int, *, is_real: bool = False) -> None:
        self.descriptor = os.memfd_create("hil-bench-program")
        os.ftruncate(self.descriptor, _SIZE)
        self._memory = mmap.mmap(self.descriptor, _SIZE)
        self._in_head = self._out_tail = self._number = 0
        buses = len(names) | is_real << 16
        for place, value in ((_VERSION, VERSION), (_BUSES, buses), (_RANDOM, _SEED)):
            _U32.pack_into(self._memory, place, value)
        for number, name in enumerate(names):
            begin = _NAMES + number * NAME_SIZE
            self._memory[begin : begin + NAME_SIZE] = name.encode().ljust(NAME_SIZE, b"\0")
        self.pass_time(now)
        _I64.pack_into(self._memory, _UNTIL, now)

    def close(self) -> None:
        """Let go of the memory."""
        self._memory.close()
        os.close(self.descriptor)

    def grant(self, until: int, received: Iterable[TimedFrame]) -> None:
        """Give the program frames, at most `RING`, and time."""
        head = self._in_head
        for time, (can_id, data, is_remote, is_extended, bus, _) in received:
            flags = is_extended * _EXTENDED | is_remote * _REMOTE
            place = _IN + head % RING * _RECORD.size
            record = (time, can_id | flags, len(data), bus, data)
            _RECORD.pack_into(self._memory, place, *record)
            head += 1
        self._in_head = head
        _U32.pack_into(self._memory, _IN_HEAD, head & 0xFFFF_FFFF)
        _I64.pack_into(self._memory, _UNTIL, until)
        self._number = self._number + 1 & 0xFFFF_FFFF
        _U32.pack_into(self._memory, _GRANTED, self._number)

    def pass_time(self, now: int) -> None:
        """Let bench time pass while the program waits, without waking it."""
        _I64.pack_into(self._memory, _NOW, now)

    def take(self) -> list[TimedFrame]:
        """Take the frames that the program has sent since the last call."""
        memory, tail = self._memory, self._out_tail
        (head,) = _U32.unpack_from(memory, _OUT_HEAD)
        sent = []
        while tail != head:
            record = _RECORD.unpack_from(memory, _OUT + tail % RING * _RECORD.size)
            time, can_id, length, bus, data = record
            is_remote, is_extended = bool(can_id & _REMOTE), bool(can_id & _EXTENDED)
            data = b"" if is_remote else data[:length]
            identifier = can_id & (0x1FFF_FFFF if is_extended else 0x7FF)
            fields = (identifier, data, is_remote, is_extended, bus, 0)
            sent.append(TimedFrame(time, make_frame(Frame, fields)))
            tail = tail + 1 & 0xFFFF_FFFF
        self._out_tail = tail
        _U32.pack_into(memory, _OUT_TAIL, tail)
        return sent

    @property
    def room(self) -> int:
        """Frames that can be given before the program has taken some."""
        return RING - (self._in_head - self._read(_IN_TAIL) & 0xFFFF_FFFF)

    @property
    def is_lived(self) -> bool:
        """Return True if the program has lived up to the end of the last grant."""
        return self._read(_ANSWERED) == self._number

    @property
    def is_attached(self) -> bool:
        """Return True if a program has found this memory."""
        return bool(self._read(_STATE) & _ATTACHED)

    @property
    def wake(self) -> int:
        """The time up to which nothing but a frame concerns the program [ns]; 0 for no such."""
        if self._read(_STATE) & _WATCHES_OTHERS:
            return 0
        (time,) = _I64.unpack_from(self._memory, _WAKE)
        return int(time)

    @property
    def refusal(self) -> str:
        """The reason for which the library refuses the program."""
        text = self._memory[_REFUSAL : _REFUSAL + _REFUSAL_SIZE]
        return text.partition(b"\0")[0].decode(errors="replace")

    def _read(self, place: int) -> int:
        (value,) = _U32.unpack_from(self._memory, place)
        return int(value)
