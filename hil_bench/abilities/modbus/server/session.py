"""The session of a master: frames in and out, on a stream or inside the process."""

import logging
import struct
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

from hil_bench.abilities.modbus.protocol.register_map import ExceptionCode
from hil_bench.abilities.modbus.protocol.unit_image import ClientMemory
from hil_bench.abilities.modbus.server.pdu import WRITES, encode_exception
from hil_bench.abilities.modbus.server.register_server import RegisterServer

# Modbus frames on a stream of bytes: MBAP for TCP, address and CRC for a serial line.
#
# Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3 (MBAP header); MODBUS over
# Serial Line V1.02, 2.5.1 (RTU frame) and 6.2.2 (CRC).

LONGEST_PDU: Final = 253

_MBAP: Final = struct.Struct(">HHHB")
_LONGEST_RTU: Final = 256
_SHORTEST_RTU: Final = 4


class Adu(NamedTuple):
    """One request.

    Attributes:
        unit_id: whom it is for.
        pdu: function code and data.
        transaction: what a TCP client tells its requests apart by.
    """

    unit_id: int
    pdu: bytes
    transaction: int = 0


class FramingError(Exception):
    """The stream holds no frames; where the next one would begin is not known."""


class Framing(Protocol):
    """Finds frames in a stream, and makes them."""

    def take(self, buffer: bytearray) -> Adu | None:
        """Remove the next frame from the buffer and return it; None while it is not whole."""

    def wrap(self, request: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response."""


class TcpFraming:
    """Frames on TCP."""

    def take(self, buffer: bytearray) -> Adu | None:
        """Remove the next frame from the buffer and return it; None while it is not whole.

        Raises:
            FramingError: the bytes there are not a header.
        """
        if len(buffer) < _MBAP.size:
            return None
        transaction, protocol, length, unit_id = _MBAP.unpack_from(buffer)
        # The length counts the unit-ID, and a PDU has at least its function code.
        if protocol != 0 or not 2 <= length <= LONGEST_PDU + 1:
            header = buffer[: _MBAP.size].hex(" ")
            raise FramingError(f"{header} is not the header of a Modbus TCP frame")
        end = _MBAP.size - 1 + length
        if len(buffer) < end:
            return None
        pdu = bytes(buffer[_MBAP.size : end])
        del buffer[:end]
        return Adu(unit_id, pdu, transaction)

    def wrap(self, request: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response."""
        return _MBAP.pack(request.transaction, 0, len(pdu) + 1, request.unit_id) + pdu


class RtuFraming:
    """Frames on a serial line.

    A frame has no length: it ends with silence, which a computer's serial driver does not show
    well. So the length is taken from the function code, and the CRC says whether it is right. Where
    it is not, the search goes on one byte later; what silence ends is dropped by who sees the time.
    """

    def take(self, buffer: bytearray) -> Adu | None:
        """Remove the next frame from the buffer and return it; None while none is whole."""
        for start in range(len(buffer) - _SHORTEST_RTU + 1):
            length = _request_length(buffer, start)
            end = start + length
            if not length or end > len(buffer):
                continue
            if crc16(buffer[start : end - 2]) == buffer[end - 2 : end]:
                frame = Adu(buffer[start], bytes(buffer[start + 1 : end - 2]))
                del buffer[:end]
                return frame
        del buffer[:-_LONGEST_RTU]
        return None

    def wrap(self, request: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response."""
        body = bytes([request.unit_id]) + pdu
        return body + crc16(body)


def crc16(data: bytes | bytearray) -> bytes:
    """Return the check sum of an RTU frame, low byte first as it is sent."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc.to_bytes(2, "little")


def _crc_of_byte(crc: int) -> int:
    for _ in range(8):
        crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


_CRC_TABLE: Final = tuple(_crc_of_byte(byte) for byte in range(256))


_LENGTHS: Final = (
    dict.fromkeys((1, 2, 3, 4, 5, 6, 8), 8)
    | {22: 10, 43: 7}
    | dict.fromkeys((7, 11, 12, 17), 4)  # not supported, but known, so that they get an exception
)
"""Length of a request frame of fixed length [byte], by its function code."""

_COUNTED: Final = {15: (6, 9), 16: (6, 9), 23: (10, 13)}
"""Where the others have their byte count, and how many bytes it does not count."""


def _request_length(buffer: bytearray, start: int) -> int:
    """Return the length [byte] of a request frame by its function code; 0 while it is not known."""
    function = buffer[start + 1]
    if function in _COUNTED:
        place, others = _COUNTED[function]
        return buffer[start + place] + others if len(buffer) > start + place else 0
    return _LENGTHS.get(function, 0)


# One connection, or one serial line: bytes in, bytes out, requests answered in their order.
#
# Everything that a peer sends is looked at in `ModbusSession._work`, whether it came just now or
# waited behind a write. What fails there ends this session, and nothing else.

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


# A Modbus client's link whose other end is a bench in the same thread, for the demo and for
# tests.
#
# Requests go through the same frames and the same server as on TCP and RTU. A read takes no bench
# time; a write takes what the bench needs to obey it, during which its ticks run.


class EmbeddedLink:
    """A link for `hil_drivers.modbus.ModbusClient` to a server in the same process.

    Args:
        server: answers the requests.
        wait: lets bench time pass [s].
        period: of the ticks [s].
        framing: the client's, which finds its responses.
        is_serial: whether its frames are those of RTU.

    Attributes:
        description: how messages name it.
        framing: as passed in.
        is_cut: set it, and the link is lost, and cannot be opened until it is taken back.
    """

    def __init__(
        self,
        server: RegisterServer,
        wait: Callable[[float], None],
        period: float,
        *,
        framing: Any,  # noqa: ANN401 - a type of the drivers, which the bench does not know
        is_serial: bool,
    ) -> None:
        self.description = "embedded bench"
        self.framing = framing
        self.is_cut = False
        self.wait = wait
        self._server = server
        self._period = period
        self._make_session = serial_session if is_serial else tcp_session
        self._session: ModbusSession | None = None
        self._received = bytearray()
        self._reason = ""

    def open(self, timeout: float) -> None:  # noqa: ARG002 - it opens at once or not at all
        """Open it.

        Raises:
            ConnectionRefusedError: it is cut.
        """
        if self.is_cut:
            raise ConnectionRefusedError("the link is cut")
        self._session = self._make_session(
            self._server, self._received.extend, on_failure=self._take_reason
        )
        self._received.clear()

    def close(self) -> None:
        """Close it; a response that is still to come is lost."""
        if self._session is not None:
            self._session.end()
            self._session = None

    def send(self, data: bytes) -> None:
        """Hand a request to the server; `ConnectionResetError` where the link is closed by it."""
        self._check_open().receive(data)
        self._check_open()

    def receive(self, timeout: float) -> bytes:
        """Return the received bytes, after up to `timeout` seconds of ticks if there are none yet.

        `ConnectionResetError` where the link is cut or closed.
        """
        waited = 0.0
        while not self._received and waited < timeout:
            self._check_open()
            self.wait(self._period)
            self._server.poll()
            waited += self._period
        data = bytes(self._received)
        self._received.clear()
        return data

    def _check_open(self) -> ModbusSession:
        """Return the open session.

        Raises:
            ConnectionResetError: there is none.
        """
        if self.is_cut or self._session is None:
            raise ConnectionResetError("the link is cut")
        if self._session.is_over:
            raise ConnectionResetError(f"the server has closed the connection: {self._reason}")
        return self._session

    def _take_reason(self, reason: str) -> None:
        self._reason = reason
