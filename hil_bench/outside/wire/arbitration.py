"""One bus: frames that wait, and the one with the highest priority that goes (ISO 11898-1)."""

import heapq
from typing import Final, NamedTuple

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.wire.bits import exact_bits

_NS_PER_S: Final = 1_000_000_000


class Sent(NamedTuple):
    """A frame that has been on the bus.

    Attributes:
        frame: the frame.
        released: when its sender wanted to send it [ns].
        begin: when its first bit was on the bus [ns].
        end: when the bus was free again, after the intermission [ns].
    """

    frame: Frame
    released: int
    begin: int
    end: int


def priority(frame: Frame) -> tuple[int, bool, bool, int]:
    """Return what arbitration compares, the lowest first: the bits up to the control field.

    A data frame goes before a remote frame of its identifier, and one of 11 bits before one of 29
    bits that begins with them.
    """
    if frame.is_extended:
        return frame.can_id >> 18, True, True, (frame.can_id & 0x3FFFF) << 1 | frame.is_remote
    return frame.can_id, frame.is_remote, False, 0


class Arbiter:
    """A bus on which every frame that waits takes part in each arbitration.

    Args:
        bitrate: of the bus [bit/s].
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._waiting: list[tuple[tuple[int, bool, bool, int], int, int, Frame]] = []
        self._count = 0
        self._free_at = 0

    @property
    def waiting(self) -> int:
        """Frames that have not been sent."""
        return len(self._waiting)

    def release(self, frame: Frame, now: int) -> None:
        """Have a frame wait from now on [ns]; times must not run back, and `run` comes first."""
        self._count += 1
        heapq.heappush(self._waiting, (priority(frame), self._count, now, frame))
        self._free_at = max(self._free_at, now)

    def run(self, until: int) -> list[Sent]:
        """Return the frames whose transmission begins before a time [ns]."""
        sent = []
        while self._waiting and self._free_at < until:
            _, _, released, frame = heapq.heappop(self._waiting)
            begin = self._free_at
            self._free_at = begin + exact_bits(frame) * _NS_PER_S // self._bitrate
            sent.append(Sent(frame, released, begin, self._free_at))
        return sent
