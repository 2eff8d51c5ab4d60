"""The image of a unit: its registers, and masters that rival for them."""

from collections.abc import Iterable, Mapping, Sequence

from hil_bench.abilities.modbus.protocol.register_map import (
    Assignment,
    ExceptionCode,
    Holes,
    ModbusException,
    Register,
    RegisterAccess,
    RegisterMap,
    Table,
)

# Registers that give the same command, and which of them a client means.
#
# Many PLCs write all outputs in each cycle, as one block, whether the program uses them or not.
# Where a map has two registers for one command (the set-point as a float and as an integer;
# `enable` and `control_word`), such a block holds a command and, beside it, a value that nobody
# means. So within a block a value that is as the client last wrote it gives no command while its
# rival rules, and a value that has changed makes its register the one that rules. A request for
# one value alone is always meant.

_STATE_COMMANDS = {"enable", "control_word"}
"""Two ways to lead a valve through its states."""


def find_rivals(registers: Iterable[tuple[int, Register]]) -> Mapping[int, int]:
    """Return the positions of the registers that give a command which others give too.

    Args:
        registers: of one unit, with their positions in the row of all values.

    Returns:
        For each of them the first position of its command.
    """
    commands: dict[str, list[int]] = {}
    for position, register in registers:
        if register.access is not RegisterAccess.READ:
            source = register.source
            command = "state" if source in _STATE_COMMANDS else source.upper().removesuffix(".00")
            commands.setdefault(command, []).append(position)
    return {
        position: positions[0]
        for positions in commands.values()
        if len(positions) > 1
        for position in positions
    }


class ClientMemory:
    """The last values that one client wrote to rival registers, in any unit."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}
        self._ruling: dict[int, int] = {}

    def choose(
        self, assignments: Sequence[Assignment], rivals: Mapping[int, int]
    ) -> list[Assignment]:
        """Take note of what a request writes, and return what of it is meant.

        Args:
            assignments: of the request.
            rivals: as of `find_rivals`.
        """
        in_block = len(assignments) > 1
        return [
            assignment
            for assignment in assignments
            if assignment.position not in rivals
            or self._is_meant(assignment, rivals[assignment.position], in_block=in_block)
        ]

    def _is_meant(self, assignment: Assignment, command: int, *, in_block: bool) -> bool:
        position, value = assignment.position, assignment.value
        has_changed = value != self._last.get(position, 0.0)
        if has_changed or not in_block:
            self._last[position] = value
            self._ruling[command] = position
            return True
        return self._ruling.get(command, position) == position


# The registers of one unit as its clients see them, filled from a row of values.
#
# A value is read whole or not at all: a request that begins or ends inside one gets exception 2,
# "the combination of reference number and transfer length is invalid" (MODBUS Application
# Protocol V1.1b3, chapter 7). So no client can put a value together from two ticks. An address
# where nothing is gets the same, or reads as 0, as the unit is configured.

_ADDRESSES = 1 << 16


class _TableImage:
    """One table of one unit: its words in the order of addresses, without gaps."""

    def __init__(self, registers: Sequence[tuple[int, Register]], holes: Holes) -> None:
        self._registers = registers
        self._has_zeros = holes is Holes.ZERO
        self._places: dict[int, int] = {}
        self.entries: dict[int, tuple[int, Register]] = {}
        for position, register in registers:
            for part in range(register.count):
                self._places[register.address + part] = len(self._places)
            self.entries[register.address] = (position, register)
        self._sequence = -1
        self._words: list[int] = []

    def read(self, address: int, count: int, sequence: int, row: Sequence[float]) -> list[int]:
        end = address + count
        if self._cuts(address) or self._cuts(end) or end > _ADDRESSES:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        if not self._has_zeros and not self._covers(address, end):
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        if sequence != self._sequence:
            self._fill(row)
            self._sequence = sequence
        if self._has_zeros:
            return [self._word_at(place) for place in range(address, end)]
        first = self._places[address]
        return self._words[first : first + count]

    def is_hole(self, address: int) -> bool:
        """Return True if nothing is at an address, and that is no error."""
        return self._has_zeros and address not in self._places and address < _ADDRESSES

    def _cuts(self, address: int) -> bool:
        """Return True if a value begins before an address and goes on there."""
        return address in self._places and address not in self.entries

    def _covers(self, address: int, end: int) -> bool:
        """Return True if there is a value everywhere between two addresses."""
        places = self._places
        if address not in places or end - 1 not in places:
            return False
        return places[end - 1] - places[address] == end - 1 - address

    def _word_at(self, address: int) -> int:
        place = self._places.get(address)
        return 0 if place is None else self._words[place]

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
        holes: what an address is where the map has nothing.

    Attributes:
        identification: what the device says of itself.
        rivals: the registers that give the same command, as of `find_rivals`.
    """

    def __init__(
        self,
        register_map: RegisterMap,
        first: int,
        *,
        commands: bool,
        holes: Holes = Holes.REFUSE,
    ) -> None:
        self.identification = register_map.identification
        self._writable = (
            {RegisterAccess.WRITE, RegisterAccess.COMMAND} if commands else {RegisterAccess.WRITE}
        )
        numbered = list(enumerate(register_map.registers, first))
        self.rivals = find_rivals(numbered)
        self._tables = {
            table: _TableImage([entry for entry in numbered if entry[1].table is table], holes)
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
        """Return the assignments of a write request.

        `ModbusException` 2 where something cannot be written there, or is not there as a whole; 3
        where a value is out of range.

        Args:
            table: where it writes.
            address: of the first register or bit.
            words: the new contents, one or more.
        """
        image = self._tables[table]
        assignments = []
        while words:
            if image.is_hole(address):
                address, words = address + 1, words[1:]
                continue
            position, register = self._find_writable(table, address, len(words))
            assignments.append(Assignment(position, register.decode(words[: register.count])))
            address, words = address + register.count, words[register.count :]
        return assignments

    def may_write(self, register: Register) -> bool:
        """Return True if clients may write a register of this unit."""
        return register.access in self._writable

    def parse_mask(self, address: int, and_mask: int, or_mask: int) -> list[Assignment]:
        """Return the assignments of a mask write to a holding register.

        `ModbusException` 2 where it cannot be written, or is half of a value.
        """
        if self._tables[Table.HOLDING_REGISTERS].is_hole(address):
            return []
        position, _ = self._find_writable(Table.HOLDING_REGISTERS, address, 1)
        return [Assignment(position, and_mask << 16 | or_mask, is_mask=True)]

    def _find_writable(self, table: Table, address: int, room: int) -> tuple[int, Register]:
        """Return the writable register at an address, and its position in the row.

        Raises:
            ModbusException: 2, nothing can, or it takes more than `room` registers.
        """
        position, register = self._tables[table].entries.get(address, (0, None))
        if register is None or not self.may_write(register) or room < register.count:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        return position, register
