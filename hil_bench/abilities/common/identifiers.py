"""The use of 11-bit identifiers in the predefined connection set (CiA 301, CiA 305)."""

from functools import cache
from typing import Final, NamedTuple

_BROADCASTS: Final = {
    0x000: "NMT",
    0x080: "SYNC",
    0x100: "TIME",
    0x7E4: "LSS answer",
    0x7E5: "LSS request",
}

_FUNCTIONS: Final = {
    0x080: "EMCY",
    0x180: "TPDO1",
    0x200: "RPDO1",
    0x280: "TPDO2",
    0x300: "RPDO2",
    0x380: "TPDO3",
    0x400: "RPDO3",
    0x480: "TPDO4",
    0x500: "RPDO4",
    0x580: "SDO answer",
    0x600: "SDO request",
    0x700: "heartbeat",
}
"""An identifier less its node-ID."""

_OTHER: Final = "other"


class Function(NamedTuple):
    """The function of an identifier.

    Attributes:
        name: as in ``TPDO1``.
        node_id: of the node that it belongs to; None for what concerns all.
    """

    name: str
    node_id: int | None


@cache
def function_of(can_id: int) -> Function:
    """Return the function of an 11-bit identifier in the predefined connection set.

    A device may be configured to send a PDO under any identifier; this is the default.
    """
    if can_id in _BROADCASTS:
        return Function(_BROADCASTS[can_id], None)
    name, node_id = _FUNCTIONS.get(can_id & 0x780), can_id & 0x7F
    if name is None or node_id == 0:
        return Function(_OTHER, None)
    return Function(name, node_id)
