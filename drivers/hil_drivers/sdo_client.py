"""canopen's SDO client without its thread, and with an end to every transfer.

A device may answer for ever: segments without a last one, a block that it wants again and again,
an answer just before each time-out. So a transfer has bounds, whatever answers: a number of bytes
for what is read, and a time for all of it.
"""

import contextlib
import queue
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

WaitFor = Callable[[Callable[[], bool], float], bool]
"""Waits until a condition holds (True) or a time [s] is over (False), receiving meanwhile."""

Clock = Callable[[], float]
"""Seconds on a clock that never steps back."""

ANSWERS_KEPT = 256
"""Answers that may wait to be read; what comes beyond that is refused."""

MOST_BYTES = 0x10000
"""Bytes that an upload brings at most, unless it is told otherwise."""

MOST_BYTES_OF_A_NUMBER = 8
"""The same for an object whose EDS gives it a data type of fixed size."""

LONGEST_TRANSFER = 60.0
"""Time that a transfer takes at most, unless it is told otherwise [s]."""

_SDO_ABORT = 0x80
_INITIATE_DOWNLOAD, _DOWNLOAD_INITIATED = 1, 3
_TIMED_OUT, _OUT_OF_MEMORY = 0x05040000, 0x05040005
_EXPEDITED, _HAS_SIZE, _HAS_BLOCK_SIZE = 0x02, 0x01, 0x02
_UPLOAD_INITIATED, _BLOCK_UPLOAD_INITIATED = 2, 6
_BLOCK_DOWNLOAD = 6
_SEGMENT_TAKEN, _BLOCK_ENDED = bytes([0x20, *bytes(7)]), bytes([0xA1, *bytes(7)])
_BYTES_OF_SEGMENT = 7
_LAST = 0x01


class SdoTimeout(SdoCommunicationError):  # noqa: N818 - only `Node` meets it
    """No answer in time; told apart because the caller gets another error for it."""


class SdoTooMuch(SdoError):  # noqa: N818 - only `Node` meets it
    """The device sends more than the transfer may bring; the transfer was aborted."""


class SdoTooSlow(SdoError):  # noqa: N818 - only `Node` meets it
    """The device answers, but not all within the transfer's time; the transfer was aborted."""


class _Upload:
    """The progress of one upload, and its limit in bytes."""

    def __init__(self, most_bytes: int) -> None:
        self._most = most_bytes
        self._bytes = 0
        self._is_initiated = False
        self._is_block = False

    def take(self, answer: bytes) -> str:
        """Take the next answer; return what is wrong with it, nothing where all is well."""
        if not self._is_initiated:
            self._is_initiated = True
            return self._initiate(answer)
        allowed, length = self._most, _BYTES_OF_SEGMENT
        if self._is_block:
            # Segments that were lost come again; the last one is padded, and an answer ends it.
            allowed = 2 * self._most + 2 * _BYTES_OF_SEGMENT
        else:
            length -= answer[0] >> 1 & 7
            if not length and not answer[0] & _LAST:
                return "an empty segment came that is not the last one"
        self._bytes += length
        return f"more than {self._most} bytes came" if self._bytes > allowed else ""

    def _initiate(self, answer: bytes) -> str:
        specifier, command = answer[0] >> 5, answer[0]
        self._is_block = specifier == _BLOCK_UPLOAD_INITIATED
        has_size = command & (_HAS_BLOCK_SIZE if self._is_block else _HAS_SIZE)
        is_segmented = specifier == _UPLOAD_INITIATED and not command & _EXPEDITED
        if not has_size or not (self._is_block or is_segmented):
            return ""
        announced = int.from_bytes(answer[4:8], "little")
        if announced > self._most:
            return f"{announced} bytes are announced; {self._most} are the most that is read"
        self._most = announced
        return ""


class _Transfer:
    """The client as the stream of one transfer sees it.

    A transfer that has failed has said so once. Its stream may be closed, or collected, much later,
    and would then send its last segment into whatever the client does by then: it reaches no bus.
    """

    def __init__(self, client: "PumpedSdoClient") -> None:
        self._client = client
        self._is_over = False

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever else canopen asks for
        return getattr(self._client, name)

    def request_response(self, request: bytes) -> bytes:
        """Return the answer to a request; after the transfer, one that closes its stream."""
        if self._is_over:
            return _BLOCK_ENDED if request[0] >> 5 == _BLOCK_DOWNLOAD else _SEGMENT_TAKEN
        with self._noting_failure():
            return self._client.request_response(request)

    def read_response(self) -> bytes:
        """Return the next answer."""
        with self._noting_failure():
            return self._client.read_response()

    def send_request(self, request: bytes) -> None:
        """Send a request, unless the transfer is over."""
        if not self._is_over:
            self._client.send_request(request)

    def abort(self, abort_code: int = 0x08000000) -> None:
        """Abort the transfer, unless it is over."""
        if not self._is_over:
            self._is_over = True
            self._client.abort(abort_code)

    @contextlib.contextmanager
    def _noting_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self._is_over = True
            raise


class PumpedSdoClient(SdoClient):
    """canopen's SDO client, waiting for its answers by receiving instead of on another thread.

    Attributes:
        most_bytes: that an upload brings; more is aborted.
        longest_transfer: time that a transfer takes [s]; then it is aborted.
    """

    def __init__(
        self,
        rx_cobid: int,
        tx_cobid: int,
        od: ObjectDictionary,
        wait_for: WaitFor,
        clock: Clock = time.monotonic,
    ) -> None:
        super().__init__(rx_cobid, tx_cobid, od)  # type: ignore[no-untyped-call]  # canopen has none
        self.most_bytes = MOST_BYTES
        self.longest_transfer = LONGEST_TRANSFER
        self._wait_for = wait_for
        self._clock = clock
        self._multiplexer = bytes(3)
        self._upload: _Upload | None = None
        self._deadline = float("inf")

    def receive(self, data: bytes, now: float) -> bool:  # noqa: ARG002 - every handler is told the time
        """Take an answer of the server; False refuses it as malformed."""
        if len(data) != 8 or self.responses.qsize() >= ANSWERS_KEPT:
            return False
        self.responses.put(data)
        return True

    def open(
        self,
        index: int,
        subindex: int = 0,
        mode: str = "rb",
        *args: Any,  # noqa: ANN401 - canopen's
        **options: Any,  # noqa: ANN401 - canopen's
    ) -> Any:  # noqa: ANN401 - canopen's
        """Begin a transfer, whose bounds are those of the client; see canopen."""
        self._multiplexer = struct.pack("<HB", index, subindex)
        self._deadline = self._clock() + self.longest_transfer
        self._upload = _Upload(self._most_of(index, subindex)) if "r" in mode else None
        return SdoClient.open(_Transfer(self), index, subindex, mode, *args, **options)  # type: ignore[arg-type,no-untyped-call]

    def upload(self, index: int, subindex: int) -> bytes:
        """Return the bytes of an object.

        Raises:
            SdoCommunicationError: besides what canopen says, other bytes came than announced.
        """
        with self.open(index, subindex, buffering=0) as stream:
            announced: int | None = stream.size
            data: bytes = stream.read()
        if announced is not None and len(data) != announced:
            raise SdoCommunicationError(f"{announced} bytes are announced, {len(data)} came")
        variable = self.od.get_variable(index, subindex)
        if variable is not None and variable.fixed_size:
            # Some devices send 32 bits of a number that has less.
            return data[: len(variable) // 8]
        return data

    def send_request(self, request: bytes) -> None:
        """Send a request, at once and once."""
        self.network.send_message(self.rx_cobid, request)

    def request_response(self, request: bytes) -> bytes:
        """Return the answer to a request.

        Raises:
            SdoCommunicationError: it names another object.
            SdoTimeout: there is none.
        """
        self.responses = queue.Queue()  # what came unasked is no answer
        self.send_request(request)
        try:
            answer = self.read_response()
        except SdoTimeout:
            self.abort(_TIMED_OUT)
            raise
        is_download = (request[0] >> 5, answer[0] >> 5) == (_INITIATE_DOWNLOAD, _DOWNLOAD_INITIATED)
        if is_download and answer[1:4] != request[1:4]:
            index, subindex = struct.unpack_from("<HB", answer, 1)
            raise SdoCommunicationError(f"the answer confirms 0x{index:04X}.{subindex:02X} instead")
        return answer

    def read_response(self) -> bytes:
        """Return the next answer.

        Raises:
            SdoAbortedError: the server aborted the transfer.
            SdoTimeout: it did not answer in time.
            SdoTooSlow: it did, but the whole transfer takes too long.
            SdoTooMuch: it sends more than it may.
        """
        remaining = self._deadline - self._clock()
        wait = max(min(self.RESPONSE_TIMEOUT, remaining), 0.0)
        has_come = self._wait_for(lambda: not self.responses.empty(), wait)
        if self._clock() >= self._deadline:
            self.abort(_TIMED_OUT)
            raise SdoTooSlow
        if not has_come:
            raise SdoTimeout
        response: bytes = self.responses.get_nowait()
        if response[0] == _SDO_ABORT:
            raise SdoAbortedError(struct.unpack_from("<L", response, 4)[0])
        if self._upload is not None and (wrong := self._upload.take(response)):
            self.abort(_OUT_OF_MEMORY)
            raise SdoTooMuch(wrong)
        return response

    def abort(self, abort_code: int = 0x08000000) -> None:
        """Tell the server that the present transfer is over."""
        self.send_request(struct.pack("<B3sL", _SDO_ABORT, self._multiplexer, abort_code))

    def _most_of(self, index: int, subindex: int) -> int:
        """Return the largest number of bytes that is accepted for an object."""
        variable = self.od.get_variable(index, subindex)
        is_number = variable is not None and variable.fixed_size
        return min(self.most_bytes, MOST_BYTES_OF_A_NUMBER) if is_number else self.most_bytes
