"""The CAN frame as the devices see it: a value, free of any bus library."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple


class Frame(NamedTuple):
    """One classical CAN data or remote frame (ISO 11898-1).

    Attributes:
        can_id: identifier, 11 bit, or 29 bit where `is_extended` is set.
        data: payload, 0 to 8 bytes; empty for a remote frame.
        is_remote: a remote transmission request.
        is_extended: a 29-bit identifier.
        bus: the number of its bus, where a program has several; a device neither reads nor
            writes it.

    CAN FD and error frames never become a `Frame`: the transport counts and drops them.
    """

    can_id: int
    data: bytes = b""
    is_remote: bool = False
    is_extended: bool = False
    bus: int = 0


make_frame: Final[Callable[[type[Frame], tuple[int, bytes, bool, bool, int]], Frame]] = (
    tuple.__new__
)
"""Return the frame of these five fields, `make_frame(Frame, fields)`: quicker than `Frame`."""


Emit = Callable[[Frame], None]
"""Takes a frame that a service sends."""

Handler = Callable[[Frame, int], None]
"""Takes a received frame and the time [ns]."""

Routes = Mapping[int, Handler]
"""Handlers of received frames by identifier."""
