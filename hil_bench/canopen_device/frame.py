"""The CAN frame as the devices see it, and identifiers with flag bits as objects hold them."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import Variable


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


# COB-ID parameters: an identifier and its flag bits in one UNSIGNED32 (CiA 301).


DISABLED: Final = 1 << 31
"""Bit 31: the object does not exist."""
BIT_30: Final = 1 << 30
"""SYNC: the device generates it. TPDO: no remote request allowed."""
_EXTENDED: Final = 1 << 29
_UNUSED: Final = 0x1FFFF800
_CAN_ID: Final = 0x7FF

_RESTRICTED: Final = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x800),
)
"""Identifiers that no configurable object may take (CiA 301, restricted CAN-IDs)."""


def can_id(cob_id: int) -> int | None:
    """Return the 11-bit identifier, or None where the object does not exist.

    A 29-bit identifier and one that CiA 301 restricts, which a foreign EDS may give by default,
    count as not existing.
    """
    identifier = cob_id & _CAN_ID
    if cob_id & (DISABLED | _EXTENDED) or any(identifier in taken for taken in _RESTRICTED):
        return None
    return identifier


def check_identifier(cob_id: int) -> None:
    """Refuse an identifier that this device cannot take.

    29-bit identifiers are refused on purpose: no profile here uses them.

    Raises:
        SdoAbort: 0609 0030.
    """
    identifier = cob_id & _CAN_ID
    if cob_id & (_EXTENDED | _UNUSED):
        raise SdoAbort(*abort_codes.VALUE)
    if not cob_id & DISABLED and any(identifier in restricted for restricted in _RESTRICTED):
        raise SdoAbort(*abort_codes.VALUE)


def check_change(variable: Variable, cob_id: int) -> None:
    """Refuse a new value for the COB-ID parameter `variable`.

    Raises:
        SdoAbort: 0609 0030 where the identifier cannot be taken, or would change while the object
            exists and stays (bit 31 clear before and after).
    """
    check_identifier(cob_id)
    stays = not (int(variable.value) | cob_id) & DISABLED
    if stays and variable.value & _CAN_ID != cob_id & _CAN_ID:
        raise SdoAbort(*abort_codes.VALUE)
