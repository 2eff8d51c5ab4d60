"""The registers of one unit as its clients see them, filled from a row of values.

A value is read whole or not at all: a request that begins or ends inside one, or that touches an
address where nothing is, gets exception 2, "the combination of reference number and transfer length
is invalid" (MODBUS Application Protocol V1.1b3, chapter 7). So no client can put a value together
from two ticks.
"""

from collections.abc import Sequence
from typing import NamedTuple

from hil_bench.modbus.exceptions import ExceptionCode, ModbusException
from hil_bench.modbus.register_map import Access, Register, RegisterMap, Table


class Assignment(NamedTuple):
    """A value that a client wrote.

    Attributes:
        position: of the value in the row of all values.
        value: in SI, or as the object counts it.
    """

    position: int
    value: float


class _TableImage:
    """One table of one unit: its words in the order of addresses, without gaps."""

    def __init__(self, registers: Sequence[tuple[int, Register]]) -> None:
        self._registers = registers
        self._places: dict[int, int] = {}
        self.entries: dict[int, tuple[int, Register]] = {}
        self._ends: set[int] = set()
        for position, register in registers:
            for part in range(register.count):
                self._places[register.address + part] = len(self._places)
            self.entries[register.address] = (position, register)
            self._ends.add(register.address + register.count)
        self._sequence = -1
        self._words: list[int] = []

    def read(self, address: int, count: int, sequence: int, row: Sequence[float]) -> list[int]:
        end = address + count
        if address not in self.entries or end not in self._ends:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        first, last = self._places[address], self._places[end - 1]
        if last - first != count - 1:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        if sequence != self._sequence:
            self._fill(row)
            self._sequence = sequence
        return self._words[first : last + 1]

    def _fill(self, row: Sequence[float]) -> None:
        self._words = [
            word
            for position, register in self._registers
            for word in register.encode(row[position])
        ]


class UnitImage:
    """One unit: which part of the row is its values, and how they are read and written.

    Args:
        register_map: what it shows.
        first: position of its first value in the row; the others follow in the map's order.
        commands: whether clients may write what commands the device.
    """

    def __init__(self, register_map: RegisterMap, first: int, *, commands: bool) -> None:
        self.identification = register_map.identification
        self._writable = {Access.WRITE, Access.COMMAND} if commands else {Access.WRITE}
        numbered = list(enumerate(register_map.registers, first))
        self._tables = {
            table: _TableImage([entry for entry in numbered if entry[1].table is table])
            for table in Table
        }

    def read(
        self, table: Table, address: int, count: int, sequence: int, row: Sequence[float]
    ) -> list[int]:
        """Return registers or bits; `ModbusException` 2 where there are none such.

        Args:
            table: where to read.
            address: of the first one.
            count: how many.
            sequence: number of the row; the same number means the same values.
            row: the values of all units.
        """
        return self._tables[table].read(address, count, sequence, row)

    def parse_write(self, table: Table, address: int, words: Sequence[int]) -> list[Assignment]:
        """Return what a write request assigns.

        Args:
            table: where it writes.
            address: of the first register or bit.
            words: the new contents, one or more.

        Raises:
            ModbusException: 2, something there cannot be written, or is not there as a whole; 3, a
                value makes no sense.
        """
        entries = self._tables[table].entries
        assignments = []
        while words:
            position, register = entries.get(address, (0, None))
            if register is None or register.access not in self._writable:
                raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
            if len(words) < register.count:
                raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
            assignments.append(Assignment(position, register.decode(words[: register.count])))
            address, words = address + register.count, words[register.count :]
        return assignments
