"""The 64-bit NAME of a device (SAE J1939-81): who it is, and who yields when addresses clash."""

from typing import Final, NamedTuple

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
