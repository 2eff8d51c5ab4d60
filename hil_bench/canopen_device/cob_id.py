"""COB-ID parameters: an identifier and its flag bits in one UNSIGNED32 (CiA 301)."""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import Variable

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
