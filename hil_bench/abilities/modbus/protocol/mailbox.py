"""The mailbox between server and bench, and the exchange through it."""

import ctypes
import multiprocessing
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from hil_bench.abilities.modbus.protocol import register_map
from hil_bench.errors import SdoAbort

# Writes of Modbus clients on their way to the loop, and its answers, in shared memory.
#
# One process posts, the loop takes; neither ever waits. The mailbox is bounded: when it is full,
# the poster says so to its client. Each entry has a number and a check sum, so that one that is
# half written is seen as not yet there, whatever order the machine's caches deliver stores in.
#
# The memory has no name in the file system, so nothing is left behind however either process
# ends.

SLOTS: Final = 16
"""Orders that may wait for the loop."""

MOST_ASSIGNMENTS: Final = 128
"""Values of one order: a request carries at most 123 registers; coils are refused beyond that."""

_HEAD: Final = struct.Struct("<QII")  # number, count or code, check sum of number, count and body
_ASSIGNMENT: Final = struct.Struct("<Hd?")
_SLOT: Final = _HEAD.size + MOST_ASSIGNMENTS * _ASSIGNMENT.size
_NUMBER: Final = struct.Struct("<Q")


class Order(NamedTuple):
    """The assignments of one write request.

    Attributes:
        number: counts from 1.
        assignments: in the order of their addresses.
    """

    number: int
    assignments: list[register_map.Assignment]


class Mailbox:
    """Orders one way, answers the other; hand it to the other process as it is started.

    Where the poster dies, another one can take its place after `resume`.
    """

    def __init__(self) -> None:
        self._orders = multiprocessing.RawArray(ctypes.c_char, SLOTS * _SLOT)
        self._answers = multiprocessing.RawArray(ctypes.c_char, SLOTS * _HEAD.size)
        self._posted = 0
        self._answered = 0
        self._codes: dict[int, int] = {}  # of answers that nobody has asked for yet
        self._unwanted: set[int] = set()
        self._taken = 0

    def resume(self) -> None:
        """Go on posting where another poster left off.

        What it had posted is obeyed once, as if it still lived. An order that it was writing when
        it died is made an empty one: the loop takes the numbers in turn, and waits for each.
        """
        self._codes, self._unwanted = {}, set()
        self._answered = max(self._find_answered(), default=0)
        waiting = range(self._answered + 1, self._answered + SLOTS + 1)
        begun = [number for number in waiting if self._number_at(number) == number]
        self._posted = max(begun, default=self._answered)
        for number in range(self._answered + 1, self._posted + 1):
            if self._body_of(number) is None:
                self._write_order(number, ())

    def post(self, assignments: Sequence[register_map.Assignment]) -> int | None:
        """Leave an order and return its number; None where there is no room."""
        self._collect()
        if self._posted - self._answered >= SLOTS or len(assignments) > MOST_ASSIGNMENTS:
            return None
        self._posted += 1
        self._write_order(self._posted, assignments)
        return self._posted

    def withdraw(self, number: int) -> None:
        """Empty an order that nobody waits for any longer; the loop may have taken it already."""
        self._write_order(number, ())
        self._unwanted.add(number)

    def answer_of(self, number: int) -> int | None:
        """Return the loop's answer to an order, once; None while there is none.

        Returns:
            0, or an exception code.
        """
        self._collect()
        return self._codes.pop(number, None)

    def _collect(self) -> None:
        """Take the answers that are there, which makes room: the loop gives them in order.

        An answer stands in its slot until the one 16 orders later takes its place, so each is kept
        here until somebody asks for it.
        """
        while self._answered < self._posted:
            number = self._answered + 1
            offset = number % SLOTS * _HEAD.size
            found, code, check_sum = _HEAD.unpack_from(self._answers, offset)
            if found != number or check_sum != _check_sum(number, code, b""):
                return
            self._answered = number
            if number in self._unwanted:
                self._unwanted.remove(number)
            else:
                self._codes[number] = int(code)

    def take(self) -> Order | None:
        """Return the next order, or None where there is none."""
        body = self._body_of(self._taken + 1)
        if body is None:
            return None
        self._taken += 1
        return Order(
            self._taken, list(map(register_map.Assignment._make, _ASSIGNMENT.iter_unpack(body)))
        )

    def answer(self, number: int, code: int) -> None:
        """Leave the answer to an order: 0, or an exception code."""
        offset = number % SLOTS * _HEAD.size
        check_sum = _check_sum(number, code, b"")
        _HEAD.pack_into(self._answers, offset, number, code, check_sum)

    def _body_of(self, number: int) -> bytes | None:
        """Return the assignments of an order as bytes; None where it is not there as a whole."""
        if self._number_at(number) != number:
            return None
        offset = number % SLOTS * _SLOT
        _, count, check_sum = _HEAD.unpack_from(self._orders, offset)
        start = offset + _HEAD.size
        body = memoryview(self._orders)[start : start + count * _ASSIGNMENT.size].tobytes()
        if count > MOST_ASSIGNMENTS or check_sum != _check_sum(number, count, body):
            return None
        return body

    def _number_at(self, number: int) -> int:
        """Return the number that stands in the slot of an order."""
        return int(_NUMBER.unpack_from(self._orders, number % SLOTS * _SLOT)[0])

    def _find_answered(self) -> Iterator[int]:
        """Yield the numbers of the answers that are there."""
        for offset in range(0, SLOTS * _HEAD.size, _HEAD.size):
            number, code, check_sum = _HEAD.unpack_from(self._answers, offset)
            if number and check_sum == _check_sum(number, code, b""):
                yield number

    def _write_order(self, number: int, assignments: Sequence[register_map.Assignment]) -> None:
        body = b"".join(_ASSIGNMENT.pack(*assignment) for assignment in assignments)
        offset = number % SLOTS * _SLOT
        struct.pack_into(f"{len(body)}s", self._orders, offset + _HEAD.size, body)
        count = len(assignments)
        _HEAD.pack_into(self._orders, offset, number, count, _check_sum(number, count, body))


def _check_sum(number: int, count: int, body: bytes) -> int:
    return zlib.crc32(_HEAD.pack(number, count, 0) + body)


# The loop's end of Modbus: publishes a row of values each tick, and obeys writes.
#
# It never waits, and does the same whether the server is in another process or in this one.

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

    register: register_map.Register
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

    Attributes:
        orders: how many have come.
    """

    def __init__(self, entries: Sequence[BoundRegister], rows: RowSink, mailbox: Mailbox) -> None:
        self._entries = tuple(entries)
        self._readers = [entry.read for entry in entries]
        self._rows = rows
        self._mailbox = mailbox
        self._obeyed: tuple[int, int] | None = None  # an order, and its answer
        self.orders = 0

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
        self.orders += order is not None
        self._obeyed = order and (order.number, self._obey(order, now))

    def write(self, assignments: Sequence[register_map.Assignment], now: int) -> None:
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
        except register_map.ModbusException as refusal:
            return refusal.code
        except SdoAbort as abort:
            if abort.code in _VALUE_ABORTS:
                return register_map.ExceptionCode.ILLEGAL_DATA_VALUE
            return register_map.ExceptionCode.SERVER_DEVICE_FAILURE
        return 0

    def _assign(self, assignment: register_map.Assignment, now: int, *, in_block: bool) -> None:
        """Write one value; `SdoAbort` where the device refuses it.

        Raises:
            ModbusException: it cannot be written, or a mask makes it an illegal value.
        """
        entry = self._entries[assignment.position]
        if entry.write is None:
            raise register_map.ModbusException(register_map.ExceptionCode.ILLEGAL_DATA_ADDRESS)
        value = _masked(entry, assignment) if assignment.is_mask else assignment.value
        if not (in_block and entry.is_setting and value == entry.read()):
            entry.write(value, now)


def _masked(entry: BoundRegister, assignment: register_map.Assignment) -> float:
    """Return the SI value of a register with some of its bits changed.

    (contents AND and_mask) OR (or_mask AND NOT and_mask): MODBUS Application Protocol V1.1b3, 6.16.
    `ModbusException` where that is no value of the register.
    """
    masks = int(assignment.value)
    and_mask, or_mask = masks >> 16, masks & _LOW_WORD
    (word,) = entry.register.encode(entry.read())
    return entry.register.decode([word & and_mask | or_mask & ~and_mask])
