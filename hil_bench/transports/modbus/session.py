"""One connection, or one serial line: bytes in, bytes out, requests answered in their order."""

from collections.abc import Callable
from functools import partial

from hil_bench.modbus.exceptions import ExceptionCode
from hil_bench.transports.modbus.framing import Frame, Framing, RtuFraming, TcpFraming
from hil_bench.transports.modbus.pdu import WRITES, encode_exception
from hil_bench.transports.modbus.register_server import RegisterServer

BACKLOG = 2048
"""Bytes that may wait while a write is under way; who sends must be held back beyond that."""

_BROADCAST = 0


class ModbusSession:
    """What was received of one peer and not yet answered.

    Args:
        framing: how requests stand in the stream.
        server: answers them.
        write: takes each response.
        is_writer: whether the peer may write; otherwise its writes get exception 1.

    Attributes:
        requests: how many came.
    """

    def __init__(
        self,
        framing: Framing,
        server: RegisterServer,
        write: Callable[[bytes], None],
        *,
        is_writer: bool = True,
    ) -> None:
        self._is_writer = is_writer
        self.requests = 0
        self._framing = framing
        self._server = server
        self._write = write
        self._buffer = bytearray()
        self._is_waiting = False
        self._is_working = False

    @property
    def is_full(self) -> bool:
        """Whether no more should be received now."""
        return len(self._buffer) >= BACKLOG

    def receive(self, data: bytes | memoryview) -> None:
        """Take what came; `FramingError` where the stream makes no sense."""
        self._buffer += data
        self._work()

    def drop(self) -> None:
        """Forget what is no whole request: silence on a serial line ends a frame."""
        if not self._is_waiting:
            self._buffer.clear()

    def _work(self) -> None:
        if self._is_working:
            return
        self._is_working = True
        try:
            while not self._is_waiting and (frame := self._framing.take(self._buffer)):
                self.requests += 1
                self._hand_over(frame)
        finally:
            self._is_working = False

    def _hand_over(self, frame: Frame) -> None:
        self._is_waiting = True
        if not self._is_writer and frame.pdu and frame.pdu[0] in WRITES:
            refusal = encode_exception(frame.pdu[0], ExceptionCode.ILLEGAL_FUNCTION)
            self._reply(frame, refusal)
            return
        self._server.handle(frame.unit_id, frame.pdu, partial(self._reply, frame))

    def _reply(self, frame: Frame, pdu: bytes) -> None:
        self._is_waiting = False
        self._write(self._framing.wrap(frame, pdu))
        self._work()


class SerialSession(ModbusSession):
    """A serial line, which others may be on too: what is for none of ours gets no answer."""

    def _hand_over(self, frame: Frame) -> None:
        units = self._server.unit_ids
        if frame.unit_id == _BROADCAST:
            for unit_id in units:
                self._server.handle(unit_id, frame.pdu, _discard)
        elif frame.unit_id in units:
            super()._hand_over(frame)


def _discard(_pdu: bytes) -> None:
    """Nobody answers a broadcast."""


def tcp_session(
    server: RegisterServer, write: Callable[[bytes], None], *, is_writer: bool = True
) -> ModbusSession:
    """Return the session of a TCP connection; arguments as those of `ModbusSession`."""
    return ModbusSession(TcpFraming(), server, write, is_writer=is_writer)


def serial_session(server: RegisterServer, write: Callable[[bytes], None]) -> SerialSession:
    """Return the session of a serial line."""
    return SerialSession(RtuFraming(), server, write)
