"""The bus as the checks see it: raw frames and SDO on one clock.

The SDO client takes nothing for granted, and can ask for nonsense (CiA 301, 7.2.4).
"""

import struct
from collections.abc import Callable, Iterable
from itertools import count
from typing import NamedTuple

import can

from hil_bench.abilities.common.stamps import SteadyStamps
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused, Silence
from hil_bench.canopen_device.frame import Frame
from hil_bench.config.objects import name_object
from hil_bench.errors import BusError, first_line
from hil_bench.outside.messages import frame_of, message_of

Matches = Callable[[Frame], bool]
"""Whether a frame is the one that is waited for."""

_RESOLUTION = 1e-6
"""A wait shorter than this [s] is over: some buses and clocks cannot tell it from none."""

_LONGEST_INBOX = 100_000

BACKLOG = 1000
"""Frames taken when a wait is over: those that had come by then, and no flood that goes on."""


class Arrival(NamedTuple):
    """A frame that came.

    Attributes:
        frame: the frame.
        time: when it came [s]; only differences mean something.
    """

    frame: Frame
    time: float


class Wire:
    """One end of a bus.

    What arrives stays in the inbox until somebody takes it, so that an answer, an emergency message
    and a PDO may come in any order.

    Args:
        bus: any open python-can bus; it stays the caller's to shut down.
        clock: seconds on a clock that never steps back; the bus's own where its time is virtual.
    """

    def __init__(self, bus: can.BusABC, clock: Callable[[], float]) -> None:
        self.now = clock
        self._bus = bus
        self._inbox: list[Arrival] = []
        self._stamps = SteadyStamps()

    def send(self, *frames: Frame) -> None:
        """Send frames.

        Raises:
            BusError: the bus is lost.
            NotApplicable: a remote frame is among them, and the bus has none.
        """
        if not getattr(self._bus, "carries_remote", True) and any(
            each.is_remote for each in frames
        ):
            raise NotApplicable(f"{self._bus.channel_info}: this bus has no remote frames")
        try:
            for frame in frames:
                self._bus.send(message_of(frame))
        except (can.CanError, OSError) as error:
            raise BusError(f"{self._bus.channel_info}: {first_line(error)}") from error

    def take(self, matches: Matches, timeout: float) -> Arrival | None:
        """Return the first frame that matches, and remove it; None where none came in time [s]."""
        deadline = self.now() + timeout
        seen = late = 0
        while True:
            for position in range(seen, len(self._inbox)):
                if matches(self._inbox[position].frame):
                    return self._inbox.pop(position)
            seen = len(self._inbox)
            remaining = deadline - self.now()
            if remaining > _RESOLUTION:
                self._receive(remaining)
            elif late >= BACKLOG or not self._receive(0.0):
                return None
            else:
                late += 1

    def take_all(self, matches: Matches, duration: float) -> list[Arrival]:
        """Return, and remove, all that match, after waiting for the whole time [s]."""
        self.wait(duration)
        taken = [arrival for arrival in self._inbox if matches(arrival.frame)]
        self._inbox = [arrival for arrival in self._inbox if not matches(arrival.frame)]
        return taken

    def wait(self, duration: float) -> None:
        """Receive for some time [s]."""
        deadline = self.now() + duration
        while (remaining := deadline - self.now()) > _RESOLUTION:
            self._receive(remaining)
        for _ in range(BACKLOG):
            if not self._receive(0.0):
                return

    def forget(self) -> None:
        """Throw away all that has arrived."""
        self.wait(0.0)
        self._inbox.clear()

    def _receive(self, timeout: float) -> bool:
        """Put one message into the inbox; whether one came.

        Raises:
            BusError: the bus is lost.
        """
        try:
            message = self._bus.recv(timeout)
        except (can.CanError, OSError) as error:
            raise BusError(f"{self._bus.channel_info}: {first_line(error)}") from error
        if message is None:
            return False
        self._stamps.straighten(message)
        frame = frame_of(message)
        if frame is not None and not frame.fd:
            self._inbox.append(Arrival(frame, message.timestamp))
            del self._inbox[:-_LONGEST_INBOX]
        return True


# An SDO client.

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


LATEST = 2.0
"""Time that an answer may be late, after which it is not waited for any more [s]."""


class SdoClient:
    """The client side of one channel.

    Args:
        wire: the bus.
        request_id: identifier from client to server.
        answer_id: identifier from server to client.
        patience: longest wait for an answer, and how long silence is waited for [s].

    Attributes:
        delay: time from a request to its answer that came too late [s]; 0 while none did.
    """

    def __init__(self, wire: Wire, request_id: int, answer_id: int, patience: float) -> None:
        self.request_id = request_id
        self.answer_id = answer_id
        self._wire = wire
        self._patience = patience
        self._object = bytes(3)
        self._unanswered: float | None = None
        self.delay = 0.0

    def send(self, request: bytes) -> None:
        """Send a frame."""
        if _names_object(request):
            self._object = request[1:4]
        self._wire.send(Frame(self.request_id, request))

    def answer(self, *, timeout: float | None = None) -> bytes | None:
        """Return the next answer, None where none comes."""
        arrival = self._wire.take(self._is_answer, self._patience if timeout is None else timeout)
        return None if arrival is None else arrival.frame.data

    def answers_twice(self) -> bool:
        """Return True if two answers come to one read, though no other client has asked.

        Two devices of one type may have the same 1000h, and their answers be one frame on the bus;
        the serial number is then another.
        """

        def is_of_channel(frame: Frame) -> bool:
            return is_data(frame, self.answer_id) or is_data(frame, self.request_id)

        for key in ((0x1000, 0), (0x1018, 4)):
            self._wire.forget()
            self.send(upload_request(*key))
            heard = self._wire.take_all(is_of_channel, self._patience)
            ids = [each.frame.can_id for each in heard]
            if ids.count(self.answer_id) > 1 and self.request_id not in ids:
                return True
        return False

    def catches_up(self, timeout: float) -> bool:
        """Return True if the device answers within a time [s], with whatever; ask it to by a read.

        The read names another object than the last request, and answers keep the order of their
        requests: those that came too late are no longer taken for answers to what comes next.
        """
        request = upload_request(0x1001 if self._object[:2] == b"\x00\x10" else 0x1000)
        self.send(request)
        deadline, is_there = self._wire.now() + timeout, False
        while (answer := self.answer(timeout=deadline - self._wire.now())) is not None:
            is_there = True
            if answer[:1] and answer[0] >> 5 in {2, 4} and answer[1:4] == request[1:4]:
                self._unanswered = None
                return True
            if self._unanswered is not None:
                self.delay = self._wire.now() - self._unanswered
            if self._wire.now() > deadline:
                break
        return is_there  # one that answers by other objects is there, too

    def exchange(self, request: bytes, *, timeout: float | None = None) -> bytes:
        """Send a request and return its answer.

        Raises:
            Silence: none came.
            Deviation: it has not 8 bytes.
        """
        if self._unanswered is not None:
            self.catches_up(LATEST)
        timeout = self._patience if timeout is None else timeout
        begin = self._wire.now()
        self.send(request)
        answer = self.answer(timeout=timeout)
        if answer is None:
            self._unanswered = begin
            raise Silence(f"{shown(request)}: no answer within {timeout:g} s")
        if len(answer) != 8:
            raise Deviation(wrong(request, answer, "8 bytes are right"))
        return answer

    def expect(self, request: bytes, right: bytes) -> bytes:
        """Send a request and return its answer.

        Raises:
            Deviation: it does not begin with the right bytes.
        """
        answer = self.exchange(request)
        if not answer.startswith(right):
            raise Deviation(wrong(request, answer, f"{shown(right)} ... is right"))
        return answer

    def expect_silence(self, request: bytes) -> None:
        """Send something that gets no answer.

        Raises:
            Deviation: it got one.
        """
        self.send(request)
        answer = self.answer()
        if answer is not None:
            raise Deviation(wrong(request, answer, "silence is right"))

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
            Deviation: it is no abort, has another code, or names another object than the request.
        """
        codes = tuple(codes)
        right = " or ".join(map(code_text, codes)) or "an abort"
        if answer[0] != _ABORT:
            raise Deviation(wrong(request, answer, f"{right} is right"))
        code = int.from_bytes(answer[4:], "little")
        if codes and code not in codes:
            raise Deviation(f"{shown(request)}: abort {code_text(code)}; {right} is right")
        if _names_object(request) and answer[1:4] != request[1:4]:
            raise Deviation(f"the abort {shown(answer)} names another object than {shown(request)}")
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
                right = "a segment with the toggle bit of the request"
                raise Deviation(wrong(request, answer, f"{right} is right"))
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
        self._check_abort(name_object(index, subindex), answer)
        if answer[0] != 0x20 | (number & 1) << 4:
            right = "a confirmation with the toggle bit of the request"
            raise Deviation(wrong(request, answer, f"{right} is right"))

    def _check_initiated(self, request: bytes, answer: bytes, specifier: int) -> None:
        self._check_abort(name_object(*struct.unpack_from("<HB", request, 1)), answer)
        if answer[0] >> 5 != specifier or answer[1:4] != request[1:4]:
            right = f"command specifier {specifier} and the object of the request"
            raise Deviation(wrong(request, answer, f"{right} are right"))

    def _check_abort(self, place: str, answer: bytes) -> None:
        """Tell an abort that should not be.

        Raises:
            Refused: it is one.
        """
        if answer[0] == _ABORT:
            code = int.from_bytes(answer[4:], "little")
            raise Refused(f"{place}: abort {code_text(code)}", code)

    def _is_answer(self, frame: Frame) -> bool:
        return is_data(frame, self.answer_id)


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


def is_data(frame: Frame, can_id: int) -> bool:
    """Return True if a frame is a data frame with this 11-bit identifier."""
    return frame.can_id == can_id and not frame.is_extended and not frame.is_remote


def shown(data: bytes) -> str:
    """Return bytes as people read them on a bus."""
    return data.hex(" ").upper() or "(no byte)"


def wrong(request: bytes, answer: bytes, right: str) -> str:
    """Say that an answer is not the right one, and which would be."""
    return f"{shown(request)}: answer {shown(answer)}; {right}"


def code_text(code: int) -> str:
    """Return an abort code as the standard writes it."""
    return f"{code >> 16:04X} {code & 0xFFFF:04X}h"
