"""An SDO client that takes nothing for granted, and can ask for nonsense (CiA 301, 7.2.4)."""

import struct
from collections.abc import Iterable
from itertools import count

from hil_bench.abilities.conformance.verdicts import Deviation, Refused, Silence
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.canopen_device.frame import Frame

REQUEST, ANSWER = 0x600, 0x580

_LONG = struct.Struct("<BHBI")
_ABORT = 0x80
_LAST = 0x01
_TOGGLE = 0x10

MOST_BYTES = 0x10000
"""Bytes that an upload brings at most; a device that sends more has lost the end."""

LONGEST_TRANSFER = 60.0
"""Time that an upload takes at most [s]."""


class Bounds:
    """The bounds of an upload, beyond which it is given up.

    Args:
        wire: the bus, whose clock counts.
        size: bytes that the device announced, None for none.
    """

    def __init__(self, wire: Wire, size: int | None) -> None:
        self._now = wire.now
        self._end = wire.now() + LONGEST_TRANSFER
        self._most = MOST_BYTES if size is None else min(size, MOST_BYTES)
        self._size = size

    def check(self, length: int) -> None:
        """Look whether so many bytes, or segments, are within the bounds while more follow.

        Raises:
            Deviation: they are not.
        """
        if length > self._most:
            told = "" if self._size is None else f"{self._size} bytes announced; "
            raise Deviation(f"{told}more than {self._most} bytes came, and no last segment")
        if self._now() > self._end:
            raise Deviation(f"no last segment within {LONGEST_TRANSFER:g} s")


class SdoClient:
    """The client side of one channel.

    Args:
        wire: the bus.
        request_id: identifier from client to server.
        answer_id: identifier from server to client.
        patience: longest wait for an answer, and how long silence is waited for [s].
    """

    def __init__(self, wire: Wire, request_id: int, answer_id: int, patience: float) -> None:
        self.request_id = request_id
        self.answer_id = answer_id
        self._wire = wire
        self._patience = patience
        self._object = bytes(3)

    def send(self, request: bytes) -> None:
        """Send a frame."""
        if _names_object(request):
            self._object = request[1:4]
        self._wire.send(Frame(self.request_id, request))

    def answer(self, *, timeout: float | None = None) -> bytes | None:
        """Return the next answer, None where none comes."""
        arrival = self._wire.take(self._is_answer, self._patience if timeout is None else timeout)
        return None if arrival is None else arrival.frame.data

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return its answer.

        Raises:
            Silence: none came.
            Deviation: it has not 8 bytes.
        """
        self.send(request)
        answer = self.answer()
        if answer is None:
            raise Silence(f"{shown(request)}: no answer within {self._patience:g} s")
        if len(answer) != 8:
            raise Deviation(f"{shown(request)}: answer {shown(answer)}; 8 bytes are right")
        return answer

    def expect_silence(self, request: bytes) -> None:
        """Send something that gets no answer.

        Raises:
            Deviation: it got one.
        """
        self.send(request)
        answer = self.answer()
        if answer is not None:
            raise Deviation(f"{shown(request)}: answer {shown(answer)}; silence is right")

    def expect_abort(self, request: bytes, *codes: int) -> int:
        """Send a request that must be aborted, and return the code."""
        return self.judge_abort(request, self.exchange(request), codes)

    def judge_abort(self, request: bytes, answer: bytes, codes: Iterable[int]) -> int:
        """Return the code of an abort that answers a request.

        Args:
            request: what was sent, for the message.
            answer: what came.
            codes: those that are right; none where every code is.

        Raises:
            Deviation: it is no abort, or has another code.
        """
        codes = tuple(codes)
        right = " or ".join(map(code_text, codes)) or "an abort"
        if answer[0] != _ABORT:
            raise Deviation(f"{shown(request)}: answer {shown(answer)}; {right} is right")
        code = int.from_bytes(answer[4:], "little")
        if codes and code not in codes:
            raise Deviation(f"{shown(request)}: abort {code_text(code)}; {right} is right")
        return code

    def abort_request(self) -> bytes:
        """Return the client's abort of the last transfer; it names the transfer's object."""
        return bytes([_ABORT]) + self._object + b"\0\0\0\x08"

    def abort(self) -> None:
        """End whatever is under way, and forget what it still brings."""
        self.send(self.abort_request())
        self._wire.wait(self._patience / 25)
        self._wire.forget()

    def upload(self, index: int, subindex: int = 0) -> bytes:
        """Return an object's bytes, expedited or segmented as the device likes.

        `Refused` where it was aborted, `Deviation` where the answers are not those of an upload.
        """
        request = upload_request(index, subindex)
        answer = self.exchange(request)
        self._check_initiated(request, answer, specifier=2)
        command = answer[0]
        if command & 2:
            return answer[4 : 8 - (command >> 2 & 3)] if command & 1 else answer[4:]
        size = int.from_bytes(answer[4:], "little") if command & 1 else None
        return self.upload_segments(size)

    def upload_segments(self, size: int | None) -> bytes:
        """Return the bytes in the segments of an initiated upload.

        Args:
            size: bytes that the device announced, None for none.

        Raises:
            Deviation: a toggle bit or the number of bytes is wrong, or there is no end.
        """
        data = bytearray()
        bounds = Bounds(self._wire, size)
        for number in count():
            request = bytes([0x60 | (number & 1) << 4, *bytes(7)])
            answer = self.exchange(request)
            if answer[0] >> 5 != 0 or answer[0] & _TOGGLE != request[0] & _TOGGLE:
                raise Deviation(
                    f"{shown(request)}: answer {shown(answer)}; a segment with the toggle bit of "
                    "the request is right"
                )
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
            if answer[0] & _LAST:
                break
            bounds.check(max(len(data), number))
        if size is not None and len(data) != size:
            raise Deviation(f"{size} bytes announced, {len(data)} came")
        return bytes(data)

    def download(self, index: int, subindex: int, raw: bytes) -> None:
        """Write an object, expedited up to 4 bytes, else in segments."""
        if 1 <= len(raw) <= 4:
            request = download_request(index, subindex, raw)
            self._check_initiated(request, self.exchange(request), specifier=3)
        else:
            self.download_segments(index, subindex, raw, announced=len(raw))

    def download_segments(
        self, index: int, subindex: int, raw: bytes, *, announced: int | None
    ) -> None:
        """Write an object in segments, whatever its length.

        Args:
            index: of the object.
            subindex: of the object.
            raw: the bytes.
            announced: length that the device is told, None for none.
        """
        request = segmented_request(index, subindex, announced)
        self._check_initiated(request, self.exchange(request), specifier=3)
        for number, request in enumerate(segments(raw)):
            self.send_segment(index, subindex, request, number)

    def send_segment(self, index: int, subindex: int, request: bytes, number: int) -> None:
        """Send a segment of a download of an object, by its number from 0.

        Raises:
            Deviation: it is not confirmed.
        """
        answer = self.exchange(request)
        self._check_abort(f"0x{index:04X}.{subindex:02X}", answer)
        if answer[0] != 0x20 | (number & 1) << 4:
            raise Deviation(
                f"{shown(request)}: answer {shown(answer)}; a confirmation with the toggle bit of "
                "the request is right"
            )

    def _check_initiated(self, request: bytes, answer: bytes, specifier: int) -> None:
        index, subindex = struct.unpack_from("<HB", request, 1)
        self._check_abort(f"0x{index:04X}.{subindex:02X}", answer)
        if answer[0] >> 5 != specifier or answer[1:4] != request[1:4]:
            raise Deviation(
                f"{shown(request)}: answer {shown(answer)}; command specifier {specifier} and the "
                "object of the request are right"
            )

    def _check_abort(self, place: str, answer: bytes) -> None:
        """Tell an abort that should not be.

        Raises:
            Refused: it is one.
        """
        if answer[0] == _ABORT:
            code = int.from_bytes(answer[4:], "little")
            raise Refused(f"{place}: abort {code_text(code)}", code)

    def _is_answer(self, frame: Frame) -> bool:
        is_data = not frame.is_extended and not frame.is_remote
        return is_data and frame.can_id == self.answer_id


def upload_request(index: int, subindex: int = 0) -> bytes:
    """Return the request of an upload."""
    return _LONG.pack(0x40, index, subindex, 0)


def download_request(index: int, subindex: int, raw: bytes) -> bytes:
    """Return the request of an expedited download of 1 to 4 bytes."""
    command = 0x23 | (4 - len(raw)) << 2
    return struct.pack("<BHB", command, index, subindex) + raw.ljust(4, b"\0")


def segmented_request(index: int, subindex: int, size: int | None) -> bytes:
    """Return the first request of a segmented download, with or without its size."""
    return _LONG.pack(0x20 if size is None else 0x21, index, subindex, size or 0)


def segments(raw: bytes) -> list[bytes]:
    """Return the segments of a download."""
    chunks = [raw[start : start + 7] for start in range(0, len(raw), 7)] or [b""]
    return [
        bytes([(number & 1) << 4 | (7 - len(chunk)) << 1 | (number == len(chunks) - 1)])
        + chunk.ljust(7, b"\0")
        for number, chunk in enumerate(chunks)
    ]


def _names_object(request: bytes) -> bool:
    """Return True if a request is the first of a transfer: it names the transfer's object."""
    if len(request) != 8:
        return False
    return request[0] >> 5 in {1, 2} or request[0] & 0xE3 == 0xA0 or request[0] & 0xE1 == 0xC0


def shown(data: bytes) -> str:
    """Return bytes as people read them on a bus."""
    return data.hex(" ").upper() or "(no byte)"


def code_text(code: int) -> str:
    """Return an abort code as the standard writes it."""
    return f"{code >> 16:04X} {code & 0xFFFF:04X}h"
