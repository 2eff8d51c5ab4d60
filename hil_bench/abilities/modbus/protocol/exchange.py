"""The loop's end of Modbus: publishes a row of values each tick, and obeys writes.

It never waits, and does the same whether the server is in another process or in this one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from hil_bench.abilities.modbus.protocol.assignment import Assignment
from hil_bench.abilities.modbus.protocol.exceptions import ExceptionCode, ModbusException
from hil_bench.abilities.modbus.protocol.mailbox import Mailbox, Order
from hil_bench.abilities.modbus.protocol.register_map import Register
from hil_bench.errors import SdoAbort

_VALUE_ABORTS = range(0x06090030, 0x0609003A)
_LOW_WORD = 0xFFFF


class RowSink(Protocol):
    """The destination of the rows."""

    def write(self, values: Sequence[float]) -> None:
        """Publish one row."""


@dataclass(frozen=True, slots=True)
class BoundRegister:
    """One register of one unit, and the value of the device behind it.

    Attributes:
        register: how it stands in the registers.
        read: returns its present value, in SI.
        write: sets it at a bench time [ns], or raises `SdoAbort`; None where nobody may.
        is_setting: whether it keeps what is written, so that the same again changes nothing.
        is_first: whether a request that writes several values writes it first.
    """

    register: Register
    read: Callable[[], float]
    write: Callable[[float, int], None] | None
    is_setting: bool = False
    is_first: bool = False


class Exchange:
    """Rows out, orders in.

    Args:
        entries: of all units, in the order of the row.
        rows: where the rows go.
        mailbox: where the orders come from.
    """

    def __init__(self, entries: Sequence[BoundRegister], rows: RowSink, mailbox: Mailbox) -> None:
        self._entries = tuple(entries)
        self._readers = [entry.read for entry in entries]
        self._rows = rows
        self._mailbox = mailbox
        self._obeyed: tuple[int, int] | None = None  # an order, and its answer

    def exchange(self, now: int) -> None:
        """Publish the values of this tick, and obey a write that waits.

        It is answered after the next row, so that who reads then sees what became of it.

        Args:
            now: time of the tick [ns].
        """
        self._rows.write([read() for read in self._readers])
        mailbox = self._mailbox
        if self._obeyed is not None:
            mailbox.answer(*self._obeyed)
        order = mailbox.take()
        self._obeyed = order and (order.number, self._obey(order, now))

    def write(self, assignments: Sequence[Assignment], now: int) -> None:
        """Write the values of one request, up to the first that is refused.

        Args:
            assignments: in the order of their addresses.
            now: time of the tick [ns].

        `ModbusException` where the server refuses one, `SdoAbort` where its device does.
        """
        in_block, entries = len(assignments) > 1, self._entries
        for assignment in sorted(assignments, key=lambda a: not entries[a.position].is_first):
            self._assign(assignment, now, in_block=in_block)

    def _obey(self, order: Order, now: int) -> int:
        """Return 0, or the exception code of the first value that is refused."""
        try:
            self.write(order.assignments, now)
        except ModbusException as refusal:
            return refusal.code
        except SdoAbort as abort:
            if abort.code in _VALUE_ABORTS:
                return ExceptionCode.ILLEGAL_DATA_VALUE
            return ExceptionCode.SERVER_DEVICE_FAILURE
        return 0

    def _assign(self, assignment: Assignment, now: int, *, in_block: bool) -> None:
        """Write one value; `SdoAbort` where the device refuses it.

        Raises:
            ModbusException: it cannot be written, or a mask makes it an illegal value.
        """
        entry = self._entries[assignment.position]
        if entry.write is None:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
        value = _masked(entry, assignment) if assignment.is_mask else assignment.value
        if not (in_block and entry.is_setting and value == entry.read()):
            entry.write(value, now)


def _masked(entry: BoundRegister, assignment: Assignment) -> float:
    """Return the SI value of a register with some of its bits changed.

    (contents AND and_mask) OR (or_mask AND NOT and_mask): MODBUS Application Protocol V1.1b3, 6.16.
    `ModbusException` where that is no value of the register.
    """
    masks = int(assignment.value)
    and_mask, or_mask = masks >> 16, masks & _LOW_WORD
    (word,) = entry.register.encode(entry.read())
    return entry.register.decode([word & and_mask | or_mask & ~and_mask])
