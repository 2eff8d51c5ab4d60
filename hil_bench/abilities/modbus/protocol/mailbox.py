"""Writes of Modbus clients on their way to the loop, and its answers, in shared memory.

One process posts, the loop takes; neither ever waits. The mailbox is bounded: when it is full, the
poster says so to its client. Each entry has a number and a check sum, so that one that is half
written is seen as not yet there, whatever order the machine's caches deliver stores in.

The memory has no name in the file system, so nothing is left behind however either process ends.
"""

import ctypes
import multiprocessing
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from hil_bench.abilities.modbus.protocol.assignment import Assignment

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
    assignments: list[Assignment]


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

    def post(self, assignments: Sequence[Assignment]) -> int | None:
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
        return Order(self._taken, list(map(Assignment._make, _ASSIGNMENT.iter_unpack(body))))

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

    def _write_order(self, number: int, assignments: Sequence[Assignment]) -> None:
        body = b"".join(_ASSIGNMENT.pack(*assignment) for assignment in assignments)
        offset = number % SLOTS * _SLOT
        struct.pack_into(f"{len(body)}s", self._orders, offset + _HEAD.size, body)
        count = len(assignments)
        _HEAD.pack_into(self._orders, offset, number, count, _check_sum(number, count, body))


def _check_sum(number: int, count: int, body: bytes) -> int:
    return zlib.crc32(_HEAD.pack(number, count, 0) + body)
