"""The 64-bit NAME of a device (SAE J1939-81)."""

from typing import Final, NamedTuple, Self

BYTES: Final = 8

_WIDTHS: Final = (21, 11, 3, 5, 8, 1, 7, 4, 3, 1)
"""Bits of each field, the lowest first; the sixth is reserved."""

_RESERVED: Final = 5


class Name(NamedTuple):
    """The NAME of a device; of two that want one address, the smaller number wins.

    Attributes:
        identity: serial number, 21 bits.
        manufacturer: its code, 11 bits.
        ecu_instance: 3 bits.
        function_instance: 5 bits.
        function: what it does, 8 bits.
        vehicle_system: 7 bits.
        vehicle_system_instance: 4 bits.
        industry_group: 3 bits: 0 global, 2 agriculture, 3 construction, 5 industrial.
        arbitrary_address: 1 where it may take another address than it wants.
    """

    identity: int
    manufacturer: int = 0
    ecu_instance: int = 0
    function_instance: int = 0
    function: int = 0
    vehicle_system: int = 0
    vehicle_system_instance: int = 0
    industry_group: int = 0
    arbitrary_address: int = 0

    @classmethod
    def parse(cls, data: bytes) -> Self:
        """Return the NAME of eight bytes."""
        number, fields = int.from_bytes(data, "little"), []
        for width in _WIDTHS:
            fields.append(number & (1 << width) - 1)
            number >>= width
        del fields[_RESERVED]
        return cls(*fields)

    def pack(self) -> bytes:
        """Return the eight bytes.

        Raises:
            ValueError: a field is too large.
        """
        fields = [*self]
        fields.insert(_RESERVED, 0)
        number = place = 0
        for field, width in zip(fields, _WIDTHS, strict=True):
            if not 0 <= field < 1 << width:
                raise ValueError(f"{self}: {field} does not fit into {width} bits")
            number |= field << place
            place += width
        return number.to_bytes(BYTES, "little")
