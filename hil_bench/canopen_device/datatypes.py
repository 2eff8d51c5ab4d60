"""The CiA 301 data types: what a value is on the bus, and which values there are."""

import struct
from abc import ABC, abstractmethod
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort

Value = bool | int | float | str | bytes

_LARGEST_REAL32: Final = struct.unpack("<f", bytes.fromhex("ffff7f7f"))[0]
_LARGEST_REAL64: Final = struct.unpack("<d", bytes.fromhex("ffffffffffffef7f"))[0]


class DataType(ABC):
    """One data type.

    Attributes:
        code: its index in the object dictionary, as in an EDS.
        name: the standard's name.
        bits: length in a PDO mapping [bit]; 0 where the length varies.
        size: length in an SDO transfer [byte]; 0 where the length varies.
        zero: the value where an EDS gives no default.
        low: lowest finite value, None where there is no order.
        high: highest finite value, None where there is no order.
        format: the type's letter in a `struct` format, empty where it has none.
    """

    __slots__ = ("bits", "code", "format", "high", "low", "name", "size", "zero")

    def __init__(self, code: int, name: str, *, bits: int, zero: Value, letter: str = "") -> None:
        self.code = code
        self.name = name
        self.bits = bits
        self.size = (bits + 7) // 8
        self.zero = zero
        self.format = letter
        self.low: int | float | None = None
        self.high: int | float | None = None

    def __repr__(self) -> str:
        return self.name

    @abstractmethod
    def encode(self, value: Value) -> bytes:
        """Return `value` as an SDO transfer carries it; OverflowError where it does not fit."""

    @abstractmethod
    def decode(self, raw: bytes) -> Value:
        """Return the value of `raw`.

        Raises:
            SdoAbort: the length is wrong, or the bytes are no value of this type.
        """

    def check_size(self, size: int) -> None:
        """Refuse a transfer whose `size` [byte] is not that of the type.

        Raises:
            SdoAbort: 0607 0012 too long, 0607 0013 too short.
        """
        if self.size and size > self.size:
            raise SdoAbort(*abort_codes.LENGTH_TOO_HIGH)
        if self.size and size < self.size:
            raise SdoAbort(*abort_codes.LENGTH_TOO_LOW)


class BooleanType(DataType):
    """BOOLEAN: one bit in a PDO, one byte in an SDO transfer; every byte but 0 is true."""

    __slots__ = ()

    def encode(self, value: Value) -> bytes:  # noqa: D102 - told by the base class
        return b"\x01" if value else b"\x00"

    def decode(self, raw: bytes) -> bool:  # noqa: D102
        self.check_size(len(raw))
        return raw != b"\x00"


class IntegerType(DataType):
    """INTEGERn and UNSIGNEDn, little endian, two's complement."""

    __slots__ = ("signed",)

    def __init__(self, code: int, bits: int, *, signed: bool) -> None:
        letter = {8: "b", 16: "h", 32: "i", 64: "q"}.get(bits, "")
        name = f"{'INTEGER' if signed else 'UNSIGNED'}{bits}"
        super().__init__(code, name, bits=bits, zero=0, letter=letter if signed else letter.upper())
        self.signed = signed
        self.low = -(1 << (bits - 1)) if signed else 0
        self.high = (1 << (bits - 1 if signed else bits)) - 1

    def encode(self, value: Value) -> bytes:  # noqa: D102
        return int(value).to_bytes(self.size, "little", signed=self.signed)

    def decode(self, raw: bytes) -> int:  # noqa: D102
        if len(raw) != self.size:
            self.check_size(len(raw))
        return int.from_bytes(raw, "little", signed=self.signed)


class TimeType(IntegerType):
    """TIME_OF_DAY and TIME_DIFFERENCE: milliseconds in the low 32 bits, days above them."""

    __slots__ = ()

    def __init__(self, code: int, name: str) -> None:
        super().__init__(code, 48, signed=False)
        self.name = name


class RealType(DataType):
    """REAL32 and REAL64 (IEEE 754, little endian), infinities and NaN included."""

    __slots__ = ("_struct",)

    def __init__(self, code: int, bits: int) -> None:
        letter = "f" if bits == 32 else "d"
        super().__init__(code, f"REAL{bits}", bits=bits, zero=0.0, letter=letter)
        self._struct = struct.Struct(f"<{letter}")
        self.high = _LARGEST_REAL32 if bits == 32 else _LARGEST_REAL64
        self.low = -self.high

    def encode(self, value: Value) -> bytes:  # noqa: D102
        return self._struct.pack(value)

    def decode(self, raw: bytes) -> float:  # noqa: D102
        self.check_size(len(raw))
        value: float = self._struct.unpack(raw)[0]
        return value


class VisibleStringType(DataType):
    """VISIBLE_STRING: the characters 0x20 to 0x7E, and 0x00 (CiA 301, VISIBLE_CHAR)."""

    __slots__ = ()

    def encode(self, value: Value) -> bytes:  # noqa: D102
        return str(value).encode("ascii")

    def decode(self, raw: bytes) -> str:
        """Return the string.

        Raises:
            SdoAbort: 0609 0030 where a byte is no visible character.
        """
        if any(byte and not 0x20 <= byte <= 0x7E for byte in raw):
            raise SdoAbort(*abort_codes.VALUE)
        return raw.decode("ascii")


class UnicodeStringType(DataType):
    """UNICODE_STRING: UTF-16, little endian."""

    __slots__ = ()

    def encode(self, value: Value) -> bytes:  # noqa: D102
        return str(value).encode("utf-16-le")

    def decode(self, raw: bytes) -> str:
        """Return the string.

        Raises:
            SdoAbort: 0607 0010 for an odd length, 0609 0030 where it is no UTF-16.
        """
        if len(raw) % 2:
            raise SdoAbort(*abort_codes.LENGTH)
        try:
            return raw.decode("utf-16-le")
        except UnicodeDecodeError:
            raise SdoAbort(*abort_codes.VALUE) from None


class BytesType(DataType):
    """OCTET_STRING and DOMAIN: any bytes."""

    __slots__ = ()

    def encode(self, value: Value) -> bytes:
        """Return the bytes as they are.

        Raises:
            TypeError: `value` is no bytes.
        """
        if isinstance(value, bytes):
            return value
        raise TypeError(f"{self.name} holds bytes, not {value!r}")

    def decode(self, raw: bytes) -> bytes:  # noqa: D102
        return raw


BOOLEAN: Final = BooleanType(0x01, "BOOLEAN", bits=1, zero=False)
INTEGER8: Final = IntegerType(0x02, 8, signed=True)
INTEGER16: Final = IntegerType(0x03, 16, signed=True)
INTEGER24: Final = IntegerType(0x10, 24, signed=True)
INTEGER32: Final = IntegerType(0x04, 32, signed=True)
INTEGER64: Final = IntegerType(0x15, 64, signed=True)
UNSIGNED8: Final = IntegerType(0x05, 8, signed=False)
UNSIGNED16: Final = IntegerType(0x06, 16, signed=False)
UNSIGNED24: Final = IntegerType(0x16, 24, signed=False)
UNSIGNED32: Final = IntegerType(0x07, 32, signed=False)
UNSIGNED64: Final = IntegerType(0x1B, 64, signed=False)
REAL32: Final = RealType(0x08, 32)
REAL64: Final = RealType(0x11, 64)
VISIBLE_STRING: Final = VisibleStringType(0x09, "VISIBLE_STRING", bits=0, zero="")
OCTET_STRING: Final = BytesType(0x0A, "OCTET_STRING", bits=0, zero=b"")
UNICODE_STRING: Final = UnicodeStringType(0x0B, "UNICODE_STRING", bits=0, zero="")
TIME_OF_DAY: Final = TimeType(0x0C, "TIME_OF_DAY")
TIME_DIFFERENCE: Final = TimeType(0x0D, "TIME_DIFFERENCE")
DOMAIN: Final = BytesType(0x0F, "DOMAIN", bits=0, zero=b"")

DATA_TYPES: Final[dict[int, DataType]] = {
    data_type.code: data_type
    for data_type in (
        BOOLEAN,
        INTEGER8,
        INTEGER16,
        INTEGER24,
        INTEGER32,
        INTEGER64,
        IntegerType(0x12, 40, signed=True),
        IntegerType(0x13, 48, signed=True),
        IntegerType(0x14, 56, signed=True),
        IntegerType(0x18, 40, signed=False),
        IntegerType(0x19, 48, signed=False),
        IntegerType(0x1A, 56, signed=False),
        UNSIGNED8,
        UNSIGNED16,
        UNSIGNED24,
        UNSIGNED32,
        UNSIGNED64,
        REAL32,
        REAL64,
        VISIBLE_STRING,
        OCTET_STRING,
        UNICODE_STRING,
        DOMAIN,
        TIME_OF_DAY,
        TIME_DIFFERENCE,
    )
}
"""Every data type that an object may have, by its code."""
