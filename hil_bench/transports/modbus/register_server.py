"""Answers requests from the newest row of values; a write waits until the loop has taken it.

Exceptions, as the specification names them (MODBUS Application Protocol V1.1b3, chapter 7):

    1  there is no such function
    2  there is nothing at that address, or only a part of a value, or it cannot be written
    3  a count, a length or a value is wrong, or the device refused the value
    4  the loop gives no values, or took a write no longer; or the device cannot do this now
    6  more writes wait for the loop than there is room for
    11 there is no such unit
"""

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from hil_bench.modbus.exceptions import ExceptionCode, ModbusException
from hil_bench.modbus.mailbox import MOST_ASSIGNMENTS, Mailbox
from hil_bench.modbus.unit_image import UnitImage
from hil_bench.transports.modbus.pdu import (
    IDENTIFY,
    Request,
    decode_request,
    encode_exception,
    encode_response,
    identify,
)

logger = logging.getLogger(__name__)

ANSWER_TIMEOUT = 1.0
"""Longest wait for the loop to take a write [s]."""

Reply = Callable[[bytes], None]


class Row(Protocol):
    """All values of one tick."""

    @property
    def sequence(self) -> int:
        """Number of the tick."""

    @property
    def values(self) -> Sequence[float]:
        """The values of all units."""


class RowSource(Protocol):
    """Where the loop publishes its rows."""

    def read(self) -> Row | None:
        """Return the newest row, None before the first."""


class _PendingWrite(NamedTuple):
    """A write that the loop has not answered.

    Attributes:
        number: of the order.
        request: what the client asked for.
        reply: takes the response.
        deadline: when the wait is over [s].
    """

    number: int
    request: Request
    reply: Reply
    deadline: float


class RegisterServer:
    """The units of one bench.

    Args:
        units: by unit-ID.
        rows: where the values come from.
        mailbox: where writes go.
        clock: seconds that never step back.
        stale_after: age from which the newest row is refused [s].

    Attributes:
        on_wait: called whenever a write begins to wait for the loop.
    """

    def __init__(
        self,
        units: Mapping[int, UnitImage],
        rows: RowSource,
        mailbox: Mailbox,
        clock: Callable[[], float],
        *,
        stale_after: float = 0.5,
    ) -> None:
        self.on_wait: Callable[[], None] = _do_nothing
        self._units = dict(units)
        self._rows = rows
        self._mailbox = mailbox
        self._clock = clock
        self._stale_after = stale_after
        self._pending: deque[_PendingWrite] = deque()
        self._sequence = -1
        self._moved_at = clock()

    @property
    def unit_ids(self) -> frozenset[int]:
        """The units that there are."""
        return frozenset(self._units)

    @property
    def is_waiting(self) -> bool:
        """Whether a write waits for the loop, so that `poll` has something to look for."""
        return bool(self._pending)

    def handle(self, unit_id: int, pdu: bytes, reply: Reply) -> None:
        """Answer a request: a read at once, a write when the loop has taken it.

        Args:
            unit_id: whom it is for.
            pdu: function code and data, at least one byte.
            reply: is given the response, once.
        """
        try:
            response = self._answer(unit_id, pdu, reply)
        except ModbusException as refusal:
            response = encode_exception(pdu[0], refusal.code)
        if response is not None:
            reply(response)

    def poll(self) -> None:
        """Look whether the loop lives, and reply to the writes that it has answered."""
        self._watch()
        while self._pending:
            write = self._pending[0]
            code = self._mailbox.answer_of(write.number)
            if code is None:
                if self._clock() < write.deadline:
                    return
                self._mailbox.withdraw(write.number)
                code = ExceptionCode.SERVER_DEVICE_FAILURE
            self._pending.popleft()
            _deliver(write, code)

    def _answer(self, unit_id: int, pdu: bytes, reply: Reply) -> bytes | None:
        unit = self._units.get(unit_id)
        if unit is None:
            raise ModbusException(ExceptionCode.GATEWAY_TARGET_FAILED)
        if pdu[0] == IDENTIFY:
            return identify(pdu, unit.identification)
        request = decode_request(pdu)
        if not request.is_read:
            self._post(unit, request, reply)
            return None
        row = self._fresh_row()
        table, address, count = request.table, request.address, request.count
        words = unit.read(table, address, count, row.sequence, row.values)
        return encode_response(request, words)

    def _post(self, unit: UnitImage, request: Request, reply: Reply) -> None:
        """Leave a write for the loop.

        Raises:
            ModbusException: 6, there is no room.
        """
        assignments = unit.parse_write(request.table, request.address, request.words)
        self._fresh_row()
        number = None
        if len(assignments) <= MOST_ASSIGNMENTS:
            number = self._mailbox.post(assignments)
        if number is None:
            raise ModbusException(ExceptionCode.SERVER_DEVICE_BUSY)
        deadline = self._clock() + ANSWER_TIMEOUT
        self._pending.append(_PendingWrite(number, request, reply, deadline))
        self.on_wait()

    def _fresh_row(self) -> Row:
        """Return the newest row.

        Raises:
            ModbusException: 4, there is none, or it is too old.
        """
        row = self._watch()
        if row is None or self._clock() - self._moved_at > self._stale_after:
            raise ModbusException(ExceptionCode.SERVER_DEVICE_FAILURE)
        return row

    def _watch(self) -> Row | None:
        row = self._rows.read()
        if row is not None and row.sequence != self._sequence:
            self._sequence, self._moved_at = row.sequence, self._clock()
        return row


def _do_nothing() -> None:
    """Nobody wants to know."""


def _deliver(write: _PendingWrite, code: int) -> None:
    """Reply to one write; what fails in that must not keep the other writes from their replies."""
    try:
        write.reply(_write_response(write.request, code))
    except Exception:
        logger.exception("modbus: a write got no response")


def _write_response(request: Request, code: int) -> bytes:
    if code:
        return encode_exception(request.function, ExceptionCode(code))
    return encode_response(request, ())
