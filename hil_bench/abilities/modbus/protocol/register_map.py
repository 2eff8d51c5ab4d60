"""Register maps: which value of a device stands at which address, and how it is written there.

The four tables and their function codes are those of the MODBUS Application Protocol Specification
V1.1b3, 4.3. Addresses are those in the frame, from 0; the older notation (40001 for the first
holding register) is `Register.reference`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from hil_bench.abilities.modbus.protocol.data_types import BIT, DataType, WordOrder
from hil_bench.abilities.modbus.protocol.exceptions import ExceptionCode, ModbusException
from hil_bench.units import ONE, Unit


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
