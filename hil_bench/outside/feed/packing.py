"""Frames as they go through shared memory, from the loop to the server of the feed."""

import struct
from collections.abc import Iterator, Sequence

from hil_bench.canopen_device.frame import Frame

_FRAME = struct.Struct("<qIBBB8s")  # time [ns], identifier, bus, flags, length, data
_EXTENDED, _REMOTE, _RECEIVED = 1, 2, 4

MOST_FRAMES = 256
"""Frames of a message."""


def pack_frames(frames: Sequence[Frame], now: int, *, is_received: bool) -> Iterator[bytes]:
    """Yield frames as messages.

    Args:
        frames: the frames.
        now: their time [ns].
        is_received: whether the bench received them; it sent them otherwise.

    Yields:
        Up to `MOST_FRAMES` of them.
    """
    for first in range(0, len(frames), MOST_FRAMES):
        yield b"".join(
            _FRAME.pack(
                now,
                frame.can_id,
                frame.bus,
                frame.is_extended * _EXTENDED | frame.is_remote * _REMOTE | is_received * _RECEIVED,
                len(frame.data),
                frame.data,
            )
            for frame in frames[first : first + MOST_FRAMES]
        )


def unpack_frames(message: bytes) -> Iterator[tuple[Frame, int, bool]]:
    """Yield each frame of a message, its time [ns] and whether the bench received it.

    Yields:
        The frames of `pack_frames`.
    """
    for time, can_id, bus, flags, length, data in _FRAME.iter_unpack(message):
        frame = Frame(can_id, data[:length], bool(flags & _REMOTE), bool(flags & _EXTENDED), bus)
        yield frame, time, bool(flags & _RECEIVED)
