"""The CAN frame as the devices see it: a value, free of any bus library."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple


class Frame(NamedTuple):
    """One CAN data or remote frame (ISO 11898-1).

    Attributes:
        can_id: identifier, 11 bit, or 29 bit where `is_extended` is set.
        data: payload, 0 to 8 bytes, of CAN FD up to 64; empty for a remote frame.
        is_remote: a remote transmission request.
        is_extended: a 29-bit identifier.
        bus: the number of its bus, where a program has several; a device neither reads nor
            writes it.
        fd: 0 for a classical frame, the only ones that devices get and send; of CAN FD `FDF`, with
            `BRS` and `ESI` where they are set: the flags of SocketCAN's `struct canfd_frame`.

    Error frames never become a `Frame` on a transport: it counts and drops them.
    """

    can_id: int
    data: bytes = b""
    is_remote: bool = False
    is_extended: bool = False
    bus: int = 0
    fd: int = 0


BRS: Final = 0x1
"""Flag of `Frame.fd`: the data phase has a bit rate of its own."""

ESI: Final = 0x2
"""Flag of `Frame.fd`: the sender is error-passive."""

FDF: Final = 0x4
"""Flag of `Frame.fd`: a frame of CAN FD."""

make_frame: Final[Callable[[type[Frame], tuple[int, bytes, bool, bool, int, int]], Frame]] = (
    tuple.__new__
)
"""Return the frame of these six fields, `make_frame(Frame, fields)`: quicker than `Frame`."""


Emit = Callable[[Frame], None]
"""Takes a frame that a service sends."""

Handler = Callable[[Frame, int], None]
"""Takes a received frame and the time [ns]."""

Routes = Mapping[int, Handler]
"""Handlers of received frames by identifier."""
