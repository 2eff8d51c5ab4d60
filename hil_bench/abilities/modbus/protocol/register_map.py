"""A register map: its types of data, its exceptions, and the settings of its server."""

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.errors import HilBenchError
from hil_bench.units import ONE, Unit

# The encoding of numbers in 16-bit registers.
#
# Each register is sent high byte first (MODBUS Application Protocol V1.1b3, 4.2). In which order
# the two registers of a 32-bit value come is left open there, and real devices differ:
# `WordOrder`.
#
# A value that a type cannot hold stands at its nearest end. What is no number is NaN in a
# float32, in a signed integer the lowest value and in an unsigned one the highest.

_LARGEST_FLOAT32: Final = struct.unpack(">f", bytes.fromhex("7f7fffff"))[0]


class WordOrder(StrEnum):
    """The order of the two registers of a 32-bit value."""

    BIG = "big"
    """The high word, as in ABCD."""
    LITTLE = "little"
    """The low word, as in CDAB."""


class DataType(NamedTuple):
    """One type of value.

    Attributes:
        name: as in a register map.
        letter: its letter in a `struct` format.
        size: registers that it takes; 0 for a bit.
        low: lowest value.
        high: highest value.
    """

    name: str
    letter: str
    size: int
    low: float
    high: float

    @property
    def is_real(self) -> bool:
        """Return True if it holds fractions."""
        return self.letter == "f"

    @property
    def no_value(self) -> float:
        """The number that stands for an invalid value."""
        if self.is_real:
            return math.nan
        return self.low if self.low < 0 else self.high

    def encode(self, value: float, order: WordOrder) -> Sequence[int]:
        """Return the registers of a value, saturated."""
        value = self.no_value if math.isnan(value) else min(max(value, self.low), self.high)
        raw = struct.pack(f">{self.letter}", value if self.is_real else round(value))
        words = struct.unpack(f">{self.size}H", raw)
        return words if order is WordOrder.BIG else words[::-1]

    def decode(self, words: Sequence[int], order: WordOrder) -> float:
        """Return the value of its registers."""
        ordered = words if order is WordOrder.BIG else words[::-1]
        raw = struct.pack(f">{self.size}H", *ordered)
        return float(struct.unpack(f">{self.letter}", raw)[0])


BIT: Final = DataType("bit", "", 0, 0, 1)

DATA_TYPES: Final[Mapping[str, DataType]] = MappingProxyType(
    {
        data_type.name: data_type
        for data_type in (
            DataType("int16", "h", 1, -(2**15), 2**15 - 1),
            DataType("uint16", "H", 1, 0, 2**16 - 1),
            DataType("int32", "i", 2, -(2**31), 2**31 - 1),
            DataType("uint32", "I", 2, 0, 2**32 - 1),
            DataType("float32", "f", 2, -_LARGEST_FLOAT32, _LARGEST_FLOAT32),
        )
    }
)
"""The types of a register, by name."""


# Why a Modbus server refuses a request.
#
# Source: MODBUS Application Protocol Specification V1.1b3, chapter 7.


class ExceptionCode(IntEnum):
    """The exception codes that this server uses."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_DATA_ADDRESS = 2
    ILLEGAL_DATA_VALUE = 3
    SERVER_DEVICE_FAILURE = 4
    SERVER_DEVICE_BUSY = 6
    GATEWAY_TARGET_FAILED = 11


class ModbusException(HilBenchError):  # noqa: N818 - the specification's word
    """A request was refused.

    Attributes:
        code: the reason, as it goes to the client.
    """

    def __init__(self, code: ExceptionCode) -> None:
        super().__init__(f"Modbus exception {code.value}: {code.name}")
        self.code = code


# Register maps: which value of a device stands at which address, and how it is written there.
#
# The four tables and their function codes are those of the MODBUS Application Protocol
# Specification V1.1b3, 4.3. Addresses are those in the frame, from 0; the older notation (40001
# for the first holding register) is `Register.reference`.


class Table(StrEnum):
    """The four tables of a Modbus device."""

    COILS = "coils"
    DISCRETE_INPUTS = "discrete_inputs"
    INPUT_REGISTERS = "input_registers"
    HOLDING_REGISTERS = "holding_registers"

    @property
    def holds_bits(self) -> bool:
        """Return True if its entries are single bits."""
        return self in {Table.COILS, Table.DISCRETE_INPUTS}

    @property
    def is_writable(self) -> bool:
        """Return True if the protocol has functions that write it."""
        return self in {Table.COILS, Table.HOLDING_REGISTERS}


_REFERENCES = {
    Table.COILS: 1,
    Table.DISCRETE_INPUTS: 10001,
    Table.INPUT_REGISTERS: 30001,
    Table.HOLDING_REGISTERS: 40001,
}


class RegisterAccess(StrEnum):
    """The access to a value by clients."""

    READ = "r"
    WRITE = "rw"
    COMMAND = "command"
    """Who was allowed to command the device."""


class Holes(StrEnum):
    """The reaction to an access to an address that is not in the map."""

    REFUSE = "refuse"
    """An error: exception 2."""
    ZERO = "zero"
    """0, and what is written there does nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Register:
    """One value of a register map, in one or two registers or one bit.

    Attributes:
        name: as in the map.
        table: where it stands.
        address: of its first register, from 0.
        source: the quantity of the device, or the object, as in ``0x6131.01``.
        data_type: how it is written.
        unit: its unit, of which `scale` is counted.
        scale: value of one count, in `unit`.
        word_order: which register comes first.
        access: who may write it.
        low: lowest value that may be written, in `unit`; None for the type's or the device's own.
        high: highest such value.
        description: what it means.
    """

    name: str
    table: Table
    address: int
    source: str
    data_type: DataType = BIT
    unit: Unit = ONE
    scale: float = 1.0
    word_order: WordOrder = WordOrder.BIG
    access: RegisterAccess = RegisterAccess.READ
    low: float | None = None
    high: float | None = None
    description: str = ""

    @property
    def count(self) -> int:
        """Addresses that it takes."""
        return self.data_type.size or 1

    @property
    def reference(self) -> int:
        """Its number in the older notation, which tells the table by its first digit."""
        return _REFERENCES[self.table] + self.address

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest value that may be written, in `unit`."""
        low, high = self.data_type.low * self.scale, self.data_type.high * self.scale
        low = low if self.low is None else max(low, self.low)
        return low, high if self.high is None else min(high, self.high)

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest value that it can show [SI]."""
        if self.table.holds_bits:
            return 0.0, 1.0
        ends = self.data_type.low * self.scale, self.data_type.high * self.scale
        return self.unit.to_si(min(ends)), self.unit.to_si(max(ends))

    def encode(self, value: float) -> Sequence[int]:
        """Return the registers, or the bit, of a value in SI."""
        if self.table.holds_bits:
            return (int(bool(value) and not math.isnan(value)),)
        return self.data_type.encode(value / (self.unit.factor * self.scale), self.word_order)

    def decode(self, words: Sequence[int]) -> float:
        """Return the SI value that a client wrote.

        Raises:
            ModbusException: 3, the value is none, or out of range.
        """
        if self.table.holds_bits:
            return float(words[0])
        value = self.data_type.decode(words, self.word_order) * self.scale
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        if not (math.isfinite(value) and low <= value <= high):
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
        return self.unit.to_si(value)

    def as_read(self, value: float) -> float:
        """Return the SI value that a client reads for one in SI; NaN where there is none."""
        if math.isnan(value):
            return value
        words = self.encode(value)
        if self.table.holds_bits:
            return float(words[0])
        return self.unit.to_si(self.data_type.decode(words, self.word_order) * self.scale)


@dataclass(frozen=True, slots=True)
class DeviceIdentification:
    """The device identification of function 43/14; empty texts are left out.

    Attributes:
        vendor_name: object 0x00.
        product_code: object 0x01.
        revision: object 0x02.
        vendor_url: object 0x03.
        product_name: object 0x04.
        model_name: object 0x05.
        user_application_name: object 0x06.
    """

    vendor_name: str
    product_code: str
    revision: str
    vendor_url: str = ""
    product_name: str = ""
    model_name: str = ""
    user_application_name: str = ""


@dataclass(frozen=True, slots=True)
class RegisterMap:
    """All registers of one kind of device.

    Attributes:
        source: the file that it came from.
        profile: the device profile that it is for.
        identification: what the device says of itself.
        registers: in the order of tables and addresses; no address is taken twice.
    """

    source: str
    profile: str
    identification: DeviceIdentification
    registers: tuple[Register, ...] = field(default=())

    def table(self, table: Table) -> tuple[Register, ...]:
        """Return the registers of one table, in the order of their addresses."""
        return tuple(register for register in self.registers if register.table is table)


# An assignment: a part of a write request, in the form that the loop takes.


class Assignment(NamedTuple):
    """A value that a client wrote.

    Attributes:
        position: of the value in the row of all values.
        value: in SI, or as the object counts it; for a mask, AND mask << 16 | OR mask.
        is_mask: whether it changes some bits of a register only (function 22).
    """

    position: int
    value: float
    is_mask: bool = False


# The configuration of a Modbus server's process: its addresses, its line and its TLS files.


class Parity(StrEnum):
    """Parity of a serial line."""

    EVEN = "even"
    ODD = "odd"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class SerialConfig:
    """A serial line that Modbus RTU is spoken on.

    Attributes:
        port: its device file, as in ``/dev/ttyUSB0``; ``pty`` for a new pseudo-terminal.
        baud_rate: bit rate [bit/s].
        parity: of each character.
        stop_bits: of each character.
    """

    port: str
    baud_rate: int
    parity: Parity
    stop_bits: int


@dataclass(frozen=True, slots=True)
class TlsConfig:
    """Modbus/TCP Security on the TCP port; all files are PEM.

    Attributes:
        certificate: of the server, with what leads to its authority.
        key: of that certificate, without a password.
        client_ca: the authorities that clients' certificates must come from.
        writer_role: the role in a client's certificate that may write; the others read.
    """

    certificate: Path
    key: Path
    client_ca: Path
    writer_role: str


@dataclass(frozen=True, slots=True)
class ServerConfig:
    """The ways in.

    Attributes:
        is_on_tcp: whether it listens on TCP.
        host: address to listen on.
        port: TCP port; 0 for a free one.
        connections: most connections at a time.
        serial: the serial line, None for none.
        tls: certificates and roles for TCP; None for plain TCP.
        default_unit: unit-ID of the device that unit-IDs 0 and 255 reach on TCP; None for none.
    """

    is_on_tcp: bool
    host: str
    port: int
    connections: int
    serial: SerialConfig | None
    tls: TlsConfig | None = None
    default_unit: int | None = None
