"""One connection, or one serial line: bytes in, bytes out, requests answered in their order.

Everything that a peer sends is looked at in `ModbusSession._work`, whether it came just now or
waited behind a write. What fails there ends this session, and nothing else.
"""

import logging
from collections.abc import Callable
from functools import partial

from hil_bench.abilities.modbus.protocol.exceptions import ExceptionCode
from hil_bench.abilities.modbus.protocol.rivals import ClientMemory
from hil_bench.abilities.modbus.server.framing import (
    Adu,
    Framing,
    FramingError,
    RtuFraming,
    TcpFraming,
)
from hil_bench.abilities.modbus.server.pdu import WRITES, encode_exception
from hil_bench.abilities.modbus.server.register_server import RegisterServer

logger = logging.getLogger(__name__)

BACKLOG = 2048
"""Bytes that may wait while a write is under way; who sends must be held back beyond that."""

_BROADCAST = 0


def _ignore(_reason: str) -> None:
    """Leave the end of a session to whoever finds it over."""


class ModbusSession:
    """The session of one peer: its received bytes and its unanswered requests.

    No method raises because of what the peer sent, or because of a response to it.

    Args:
        framing: how requests stand in the stream.
        server: answers them.
        write: takes each response.
        on_failure: told the reason, once, when the session ends by an error.
        is_writer: whether the peer may write; otherwise its writes get exception 1.

    Attributes:
        is_writer: as passed in; may be changed.
        requests: how many came.
        is_over: whether it has ended: nothing is received or answered any more.
    """

    def __init__(
        self,
        framing: Framing,
        server: RegisterServer,
        write: Callable[[bytes], None],
        *,
        on_failure: Callable[[str], None] = _ignore,
        is_writer: bool = True,
    ) -> None:
        self.requests = 0
        self.is_over = False
        self.is_writer = is_writer
        self._framing = framing
        self._server = server
        self._write = write
        self._on_failure = on_failure
        self._memory = ClientMemory()
        self._buffer = bytearray()
        self._unanswered: Adu | None = None
        self._response: bytes | None = None
        self._is_working = False

    @property
    def is_full(self) -> bool:
        """Return True if no more should be received now."""
        return len(self._buffer) >= BACKLOG

    @property
    def is_idle(self) -> bool:
        """Return True if every whole request has its response."""
        return self._unanswered is None and self._response is None

    def receive(self, data: bytes | bytearray | memoryview) -> None:
        """Take what came."""
        if not self.is_over:
            self._buffer += data
            self._work()

    def drop(self) -> None:
        """Forget what is no whole request: silence on a serial line ends a frame."""
        if self.is_idle:
            self._buffer.clear()

    def end(self) -> None:
        """End it, as the peer is gone; a response that is still to come goes nowhere."""
        self.is_over = True
        self._drop_all()

    def _work(self) -> None:
        """Answer what can be answered now."""
        if self._is_working:
            return
        self._is_working = True
        try:
            while self._step():
                pass
        except FramingError as error:
            self._fail(str(error))
        except Exception as error:  # a defect of ours: the other clients are served on
            logger.info("modbus: a request failed", exc_info=True)
            self._fail(f"internal error: {error!r}")
        finally:
            self._is_working = False

    def _step(self) -> bool:
        """Send a response or take a request, and return whether there was one."""
        if self._response is not None:
            response, self._response = self._response, None
            self._write(response)
            return True
        if self._unanswered is not None or self.is_over:
            return False
        frame = self._framing.take(self._buffer)
        if frame is None:
            return False
        self.requests += 1
        self._hand_over(frame)
        return True

    def _hand_over(self, frame: Adu) -> None:
        self._unanswered = frame
        if not self.is_writer and frame.pdu[0] in WRITES:
            refusal = encode_exception(frame.pdu[0], ExceptionCode.ILLEGAL_FUNCTION)
            self._reply(frame, refusal)
            return
        self._server.handle(frame.unit_id, frame.pdu, partial(self._reply, frame), self._memory)

    def _reply(self, frame: Adu, pdu: bytes) -> None:
        if frame is self._unanswered:
            self._unanswered = None
            self._response = self._framing.wrap(frame, pdu)
            self._work()

    def _drop_all(self) -> None:
        self._buffer.clear()
        self._unanswered = self._response = None

    def _fail(self, reason: str) -> None:
        self.end()
        self._on_failure(reason)


class SerialSession(ModbusSession):
    """A serial line, which others may be on too: what is for none of ours gets no answer.

    An error does not end it: the line goes on with the next frame.
    """

    def _hand_over(self, frame: Adu) -> None:
        units = self._server.unit_ids
        if frame.unit_id == _BROADCAST:
            for unit_id in units:
                self._server.handle(unit_id, frame.pdu, _discard, self._memory)
        elif frame.unit_id in units:
            super()._hand_over(frame)

    def _fail(self, reason: str) -> None:
        self._drop_all()
        self._on_failure(reason)


def _discard(_pdu: bytes) -> None:
    """Nobody answers a broadcast."""


def tcp_session(
    server: RegisterServer,
    write: Callable[[bytes], None],
    *,
    on_failure: Callable[[str], None] = _ignore,
    is_writer: bool = True,
) -> ModbusSession:
    """Return the session of a TCP connection; arguments as those of `ModbusSession`."""
    return ModbusSession(TcpFraming(), server, write, on_failure=on_failure, is_writer=is_writer)


def serial_session(
    server: RegisterServer,
    write: Callable[[bytes], None],
    *,
    on_failure: Callable[[str], None] = _ignore,
) -> SerialSession:
    """Return the session of a serial line."""
    return SerialSession(RtuFraming(), server, write, on_failure=on_failure)
