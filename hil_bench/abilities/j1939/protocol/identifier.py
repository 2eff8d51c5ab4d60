"""Identifiers and NAMEs of SAE J1939."""

from typing import Final, NamedTuple

# The 29-bit identifier of SAE J1939-21.
#
# It holds priority (3 bits), data page (2), PDU format PF (8), PDU specific PS (8) and source
# address (8). A PF below 240 is sent to the address PS, and the parameter group number (PGN) is
# data page and PF; from 240 on PS belongs to the PGN and all are meant.

GLOBAL: Final = 0xFF
"""The address of all."""

NULL: Final = 0xFE
"""The source address of a device that has none."""

ACKNOWLEDGEMENT: Final = 0xE800
REQUEST: Final = 0xEA00
TRANSPORT_DATA: Final = 0xEB00
TRANSPORT_CONNECTION: Final = 0xEC00
ADDRESS_CLAIMED: Final = 0xEE00
DM1: Final = 0xFECA
DM2: Final = 0xFECB
DM3: Final = 0xFECC
COMMANDED_ADDRESS: Final = 0xFED8
SOFTWARE: Final = 0xFEDA
COMPONENT: Final = 0xFEEB
VEHICLE: Final = 0xFEEC

HIGHEST_GROUP: Final = 0x3FFFF

_TO_ALL: Final = 240


class Identifier(NamedTuple):
    """The fields of a 29-bit identifier.

    Attributes:
        priority: 0, the highest, to 7.
        group: the PGN.
        source: address of the sender.
        destination: address of the receiver; `GLOBAL` for all.
    """

    priority: int
    group: int
    source: int
    destination: int


def split(can_id: int) -> Identifier:
    """Return the parts of a 29-bit identifier."""
    group, destination = can_id >> 8 & HIGHEST_GROUP, GLOBAL
    if not is_to_all(group):
        group, destination = group & ~0xFF, group & 0xFF
    return Identifier(can_id >> 26 & 7, group, can_id & 0xFF, destination)


def join(priority: int, group: int, source: int, destination: int = GLOBAL) -> int:
    """Return the identifier of these parts; a group that is sent to all has no destination."""
    specific = 0 if is_to_all(group) else destination
    return priority << 26 | (group | specific) << 8 | source


def is_to_all(group: int) -> bool:
    """Return True if a parameter group is sent to all (PDU 2)."""
    return (group >> 8 & 0xFF) >= _TO_ALL


# The 64-bit NAME of a device (SAE J1939-81): who it is, and who yields when addresses clash.

NAME_BYTES: Final = 8


class Name(NamedTuple):
    """The NAME of a device: function, manufacturer, identity; the smaller one wins an address.

    Attributes:
        identity: serial number of the manufacturer, 21 bits.
        manufacturer: its code, 11 bits.
        ecu_instance: 3 bits.
        function_instance: 5 bits.
        function: what it does, 8 bits.
        vehicle_system: 7 bits.
        vehicle_system_instance: 4 bits.
        industry_group: 3 bits: 0 global, 2 agriculture, 3 construction, 5 industrial.
        arbitrary_address: whether it takes another address where its own is taken.
    """

    identity: int = 0
    manufacturer: int = 0
    ecu_instance: int = 0
    function_instance: int = 0
    function: int = 0
    vehicle_system: int = 0
    vehicle_system_instance: int = 0
    industry_group: int = 0
    arbitrary_address: bool = False

    def __int__(self) -> int:
        return (
            self.identity
            | self.manufacturer << 21
            | self.ecu_instance << 32
            | self.function_instance << 35
            | self.function << 40
            | self.vehicle_system << 49  # bit 48 is reserved and 0
            | self.vehicle_system_instance << 56
            | self.industry_group << 60
            | self.arbitrary_address << 63
        )

    def __bytes__(self) -> bytes:
        return int(self).to_bytes(NAME_BYTES, "little")
