"""Answers requests from the newest row of values; a write waits until the loop has taken it.

Exceptions, as the specification names them (MODBUS Application Protocol V1.1b3, chapter 7):

    1  there is no such function
    2  there is nothing at that address, or only a part of a value, or it cannot be written
    3  a count, a length or a value is wrong, or the device refused the value
    4  the loop gives no values, or took a write no longer; or the device cannot do this now
    6  more writes wait for the loop than there is room for, or one of them is too long
    11 there is no such unit
"""

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from hil_bench.abilities.modbus.protocol import register_map
from hil_bench.abilities.modbus.protocol.mailbox import MOST_ASSIGNMENTS, Mailbox
from hil_bench.abilities.modbus.protocol.unit_image import ClientMemory, UnitImage
from hil_bench.abilities.modbus.server import pdu as pdus

logger = logging.getLogger(__name__)

ANSWER_TIMEOUT = 1.0
"""Longest wait for the loop to take a write [s]."""

_STALE_AFTER = 0.5
"""Age from which the newest row is refused [s]."""

MOST_WAITING = 1024
"""Writes that may wait for room in the mailbox: each client of a full server has one."""

_DIRECT = (0, 255)
"""Unit-IDs with which a client on TCP means the device that it is connected to (MODBUS Messaging on
TCP/IP Implementation Guide V1.0b, 4.4.2.3)."""

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
    """The source of the rows that the loop publishes."""

    def read(self) -> Row | None:
        """Return the newest row, None before the first."""


class _PendingWrite(NamedTuple):
    """A write that the loop has not answered.

    Attributes:
        unit: where it writes.
        request: what the client asked for.
        assignments: what the loop is to do.
        reply: takes the response.
        deadline: when the wait is over [s].
    """

    unit: UnitImage
    request: pdus.Request
    assignments: Sequence[register_map.Assignment]
    reply: Reply
    deadline: float


class RegisterServer:
    """The units of one bench.

    Args:
        units: by unit-ID.
        rows: where the values come from.
        mailbox: where writes go.
        clock: seconds that never step back.
        default_unit: the unit that unit-IDs 0 and 255 reach; None for none.

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
        default_unit: int | None = None,
    ) -> None:
        self.on_wait: Callable[[], None] = _do_nothing
        self._units = dict(units)
        self._aliases = {} if default_unit is None else dict.fromkeys(_DIRECT, default_unit)
        self._rows = rows
        self._mailbox = mailbox
        self._clock = clock
        self._queued: deque[_PendingWrite] = deque()
        self._posted: deque[tuple[int, _PendingWrite]] = deque()
        self._sequence = -1
        self._moved_at = clock()

    @property
    def unit_ids(self) -> frozenset[int]:
        """The units that there are."""
        return frozenset(self._units)

    @property
    def is_waiting(self) -> bool:
        """Return True if a write waits for the loop, so that `poll` has something to look for."""
        return bool(self._posted or self._queued)

    def handle(
        self, unit_id: int, pdu: bytes, reply: Reply, memory: ClientMemory | None = None
    ) -> None:
        """Answer a request: a read at once, a write when the loop has taken it.

        Args:
            unit_id: whom it is for.
            pdu: function code and data, at least one byte.
            reply: is given the response, once.
            memory: what the client wrote before.
        """
        try:
            response = self._answer(unit_id, pdu, reply, memory or ClientMemory())
        except register_map.ModbusException as refusal:
            response = pdus.encode_exception(pdu[0], refusal.code)
        if response is not None:
            reply(response)

    def poll(self) -> None:
        """Look whether the loop lives, and reply to the writes that it has answered."""
        self._watch()
        while self._posted:
            number, write = self._posted[0]
            code = self._mailbox.answer_of(number)
            if code is None:
                if self._clock() < write.deadline:
                    break
                self._mailbox.withdraw(number)
                code = register_map.ExceptionCode.SERVER_DEVICE_FAILURE
            self._posted.popleft()
            self._deliver(write, code)
        self._post_queued()

    def _post_queued(self) -> None:
        """Leave the writes that wait for room for the loop, as far as there is some."""
        while self._queued:
            write = self._queued[0]
            if self._clock() >= write.deadline:
                self._queued.popleft()
                self._deliver(write, register_map.ExceptionCode.SERVER_DEVICE_FAILURE)
                continue
            number = self._mailbox.post(write.assignments)
            if number is None:
                return
            self._queued.popleft()
            self._posted.append((number, write))

    def _answer(self, unit_id: int, pdu: bytes, reply: Reply, memory: ClientMemory) -> bytes | None:
        unit = self._units.get(self._aliases.get(unit_id, unit_id))
        if unit is None:
            raise register_map.ModbusException(register_map.ExceptionCode.GATEWAY_TARGET_FAILED)
        if pdu[0] == pdus.IDENTIFY:
            return pdus.identify(pdu, unit.identification)
        request = pdus.decode_request(pdu)
        if not request.is_read:
            self._post(unit, request, reply, memory)
            return None
        words = self._read(unit, request.table, request.address, request.count)
        return pdus.encode_response(request, words)

    def _read(
        self, unit: UnitImage, table: register_map.Table, address: int, count: int
    ) -> list[int]:
        row = self._fresh_row()
        return unit.read(table, address, count, row.sequence, row.values)

    def _post(
        self, unit: UnitImage, request: pdus.Request, reply: Reply, memory: ClientMemory
    ) -> None:
        """Leave a write for the loop.

        Raises:
            ModbusException: 6, there is no room.
        """
        if request.function == pdus.MASK_WRITE:
            assignments = unit.parse_mask(request.address, *request.words)
        else:
            assignments = unit.parse_write(request.table, request.address, request.words)
        self._fresh_row()
        self._read_beside(unit, request)  # or it would be refused after the write
        if len(assignments) > MOST_ASSIGNMENTS or len(self._queued) >= MOST_WAITING:
            raise register_map.ModbusException(register_map.ExceptionCode.SERVER_DEVICE_BUSY)
        meant = memory.choose(assignments, unit.rivals)
        deadline = self._clock() + ANSWER_TIMEOUT
        self._queued.append(_PendingWrite(unit, request, meant, reply, deadline))
        self._post_queued()
        self.on_wait()

    def _read_beside(self, unit: UnitImage, request: pdus.Request) -> Sequence[int]:
        """Return the registers that function 23 reads beside its write; empty for others."""
        if request.function != pdus.READ_WRITE:
            return ()
        return self._read(unit, request.table, request.read_address, request.read_count)

    def _deliver(self, write: _PendingWrite, code: int) -> None:
        """Reply to one write; what fails here must not keep other writes from their replies."""
        try:
            write.reply(self._write_response(write, code))
        except Exception:
            logger.exception("modbus: a write got no response")

    def _write_response(self, write: _PendingWrite, code: int) -> bytes:
        request = write.request
        if code:
            return pdus.encode_exception(request.function, register_map.ExceptionCode(code))
        try:
            return pdus.encode_response(request, self._read_beside(write.unit, request))
        except register_map.ModbusException as refusal:
            return pdus.encode_exception(request.function, refusal.code)

    def _fresh_row(self) -> Row:
        """Return the newest row.

        Raises:
            ModbusException: 4, there is none, or it is too old.
        """
        row = self._watch()
        if row is None or self._clock() - self._moved_at > _STALE_AFTER:
            raise register_map.ModbusException(register_map.ExceptionCode.SERVER_DEVICE_FAILURE)
        return row

    def _watch(self) -> Row | None:
        row = self._rows.read()
        if row is not None and row.sequence != self._sequence:
            self._sequence, self._moved_at = row.sequence, self._clock()
        return row


def _do_nothing() -> None:
    """Nobody wants to know."""
