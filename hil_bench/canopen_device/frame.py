"""The CAN frame as the devices see it: a value, free of any bus library."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, NamedTuple


class Frame(NamedTuple):
    """One classical CAN data or remote frame (ISO 11898-1).

    Attributes:
        can_id: identifier, 11 bit, or 29 bit where `is_extended` is set.
        data: payload, 0 to 8 bytes; empty for a remote frame.
        is_remote: a remote transmission request.
        is_extended: a 29-bit identifier.
        bus: the number of the bus that it is on, among those of the bench.

    CAN FD and error frames never become a `Frame`: the transport counts and drops them.
    """

    can_id: int
    data: bytes = b""
    is_remote: bool = False
    is_extended: bool = False
    bus: int = 0


BUS_SHIFT = 11


def address_of(can_id: int, bus: int) -> int:
    """Return an 11-bit identifier and the number of its bus as one number; on bus 0 they are one.

    It is ``frame.can_id | frame.bus << BUS_SHIFT``, and written so where each frame passes.
    """
    return can_id | bus << BUS_SHIFT


make_frame: Final[Callable[[tuple[int, bytes, bool, bool, int]], Frame]] = partial(
    tuple.__new__, Frame
)
"""Return the frame of these five fields: as `Frame` does, but quicker."""


def frame_bits(length: int, *, is_extended: bool = False) -> float:
    """Return the bits that a frame takes on the bus, with half of the most stuff bits it can have.

    A data frame with an 11-bit identifier has 44 bits and 8 a byte, and 3 between frames; of these,
    34 and 8 a byte are stuffed, at most one bit after each four (ISO 11898-1).

    Args:
        length: data bytes.
        is_extended: whether the identifier has 29 bits.
    """
    head = 20 if is_extended else 0
    stuffed = 34 + head + 8 * length
    return 47 + head + 8 * length + (stuffed - 1) / 4 / 2


FRAME_BITS = tuple(frame_bits(length) for length in range(9))
"""`frame_bits` of a frame with an 11-bit identifier, by its length."""

Emit = Callable[[Frame], None]
"""Takes a frame that a service sends."""

Handler = Callable[[Frame, int], None]
"""Takes a received frame and the time [ns]."""

Routes = Mapping[int, Handler]
"""Handlers of received frames by identifier."""
