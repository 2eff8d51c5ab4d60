"""The 29-bit identifier of SAE J1939-21, and the parameter groups that the drivers need."""

from typing import Final, NamedTuple

GLOBAL: Final = 0xFF
"""The address of all."""

NULL: Final = 0xFE
"""The source address of a device that has none."""

ACKNOWLEDGEMENT: Final = 0xE800
REQUEST: Final = 0xEA00
TRANSPORT_DATA: Final = 0xEB00
TRANSPORT_CONTROL: Final = 0xEC00
ADDRESS_CLAIMED: Final = 0xEE00
DM1: Final = 0xFECA
COMPONENT: Final = 0xFEEB

HIGHEST_GROUP: Final = 0x3FFFF

_FIRST_TO_ALL: Final = 0xF000


class Identifier(NamedTuple):
    """The contents of a 29-bit identifier.

    Attributes:
        group: number of the parameter group (PGN).
        source: address of the sender.
        destination: address of the receiver; `GLOBAL` for all.
    """

    group: int
    source: int
    destination: int


def split(can_id: int) -> Identifier:
    """Return the parts of an identifier."""
    number, source = can_id >> 8 & HIGHEST_GROUP, can_id & 0xFF
    if number & 0xFF00 >= _FIRST_TO_ALL:
        return Identifier(number, source, GLOBAL)
    return Identifier(number & 0x3FF00, source, number & 0xFF)


def join(priority: int, group: int, source: int, destination: int) -> int:
    """Return an identifier; a group from 0xF000 on goes to all, whatever the destination."""
    is_to_all = group & 0xFF00 >= _FIRST_TO_ALL
    return priority << 26 | (group | (0 if is_to_all else destination)) << 8 | source
