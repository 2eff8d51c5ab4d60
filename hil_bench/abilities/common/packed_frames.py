"""Frames as they go through shared memory, from the loop to the recorder and to the feed."""

import struct
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter

from hil_bench.canopen_device.frame import Frame

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
