"""SDO transfers of more than one frame (CiA 301, service data objects): segmented ones."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND
from hil_bench.canopen_device.errors import SdoAbort

Multiplexer = tuple[int, int]
"""Index and sub-index: which object a transfer is about."""

Write = Callable[[bytes], None]
"""Takes the whole of what was downloaded; `SdoAbort` where the object refuses it."""

TIME_OUT: Final = 1000 * MILLISECOND
"""Longest wait for the client's next frame [ns]."""

SEGMENT_BYTES: Final = 7
SEGMENT: Final = struct.Struct(f"{SEGMENT_BYTES}s")

_DOWNLOAD_SEGMENT: Final = 0
_UPLOAD_SEGMENT: Final = 3

_TOGGLE: Final = 0x10
_LAST: Final = 0x01
_SPECIFIER_AND_TOGGLE: Final = 0xF0

_FULL_SEGMENT: Final = {_UPLOAD_SEGMENT << 5 | toggle: bytes([toggle]) for toggle in (0, _TOGGLE)}
"""The first byte of an upload segment of 7 bytes that others follow, by that of the request."""
_TAKEN: Final = {toggle: bytes([0x20 | toggle, *bytes(7)]) for toggle in (0, _TOGGLE)}
"""The confirmation of a download segment, by its toggle bit."""


class Transfer(ABC):
    """A transfer under way.

    Attributes:
        target: its object.
        due: when `proceed` is to be called [ns].
        is_over: whether it has come to its end.
    """

    def __init__(self, target: Multiplexer, now: int) -> None:
        self.target = target
        self.due = now + TIME_OUT
        self.is_over = False

    @abstractmethod
    def owns(self, command: int) -> bool:
        """Return True if a request with this command byte belongs to the transfer."""

    @abstractmethod
    def take(self, request: bytes, now: int) -> bytes | None:
        """Take a request that belongs to the transfer and return the answer, None for silence.

        `SdoAbort` ends the transfer.
        """

    def absorb(self, request: bytes, now: int) -> bytes | None:  # noqa: ARG002 - not all have one
        """Take a request in the midst of the transfer, of which its object does not hear.

        Most requests are, so this is the quick way; it only puts `due` off.

        Returns:
            The answer, empty for silence. None where it is no such request: then nothing has
            happened, and `take` is for it.
        """
        return None

    def proceed(self, now: int) -> Iterable[bytes]:  # noqa: ARG002 - block transfers use it
        """Return the frames that the server sends unasked once `due` has come.

        Raises:
            SdoAbort: 0504 0000, the client has gone silent.
        """
        raise SdoAbort(*abort_codes.TIME_OUT)


class SegmentedUpload(Transfer):
    """An upload in segments of 7 bytes, each on request."""

    def __init__(self, target: Multiplexer, data: bytes, now: int) -> None:
        super().__init__(target, now)
        followed = max(len(data) - 1, 0) // SEGMENT_BYTES * SEGMENT_BYTES
        self._full_segments = SEGMENT.iter_unpack(data[:followed])
        self._last_segment = data[followed:]
        self._expected = _UPLOAD_SEGMENT << 5

    def owns(self, command: int) -> bool:  # noqa: D102 - told by the base class
        return command >> 5 == _UPLOAD_SEGMENT

    def absorb(self, request: bytes, now: int) -> bytes | None:
        """Return a segment that others follow."""
        expected = self._expected
        if request[0] & _SPECIFIER_AND_TOGGLE != expected:
            return None
        segment = next(self._full_segments, None)
        if segment is None:
            return None
        self._expected = expected ^ _TOGGLE
        self.due = now + TIME_OUT
        answer: bytes = _FULL_SEGMENT[expected] + segment[0]
        return answer

    def take(self, request: bytes, now: int) -> bytes:
        """Return the next segment; `SdoAbort` 0503 0000 where the toggle bit is not its turn's."""
        answer = self.absorb(request, now)
        if answer is not None:
            return answer
        toggle = self._expected & _TOGGLE
        _check_toggle(request[0], toggle)
        self.is_over = True
        segment = self._last_segment
        command = toggle | (SEGMENT_BYTES - len(segment)) << 1 | _LAST
        return bytes([command]) + segment.ljust(SEGMENT_BYTES, b"\0")


class SegmentedDownload(Transfer):
    """A download in segments of up to 7 bytes, each confirmed."""

    def __init__(
        self, target: Multiplexer, write: Write, announced: int | None, limit: int, now: int
    ) -> None:
        """Begin.

        Args:
            target: its object.
            write: takes the data when they are complete.
            announced: length that the client told [byte], None where it told none.
            limit: longest that the object may be [byte].
            now: the time [ns].
        """
        super().__init__(target, now)
        self._write = write
        self._announced = announced
        self._limit = limit if announced is None else announced
        self._data = bytearray()
        self._toggle = 0

    def owns(self, command: int) -> bool:  # noqa: D102 - told by the base class
        return command >> 5 == _DOWNLOAD_SEGMENT

    def absorb(self, request: bytes, now: int) -> bytes | None:
        """Take a segment of 7 bytes that others follow."""
        toggle = self._toggle
        if request[0] != toggle or len(self._data) + SEGMENT_BYTES > self._limit:
            return None
        self._data += request[1:]
        self._toggle = toggle ^ _TOGGLE
        self.due = now + TIME_OUT
        return _TAKEN[toggle]

    def take(self, request: bytes, now: int) -> bytes:  # noqa: D102
        command, toggle = request[0], self._toggle
        _check_toggle(command, toggle)
        length = SEGMENT_BYTES - (command >> 1 & 7)
        self._data += request[1 : 1 + length]
        check_bound(len(self._data), self._limit)
        self._toggle = toggle ^ _TOGGLE
        self.due = now + TIME_OUT
        if command & _LAST:
            check_complete(len(self._data), self._announced)
            self._write(bytes(self._data))
            self.is_over = True
        return _TAKEN[toggle]


def check_bound(length: int, limit: int) -> None:
    """Refuse more bytes than fit.

    Raises:
        SdoAbort: 0607 0012.
    """
    if length > limit:
        raise SdoAbort(*abort_codes.LENGTH_TOO_HIGH)


def check_complete(length: int, announced: int | None) -> None:
    """Refuse fewer bytes than were announced.

    Raises:
        SdoAbort: 0607 0013.
    """
    if announced is not None and length < announced:
        raise SdoAbort(*abort_codes.LENGTH_TOO_LOW)


def _check_toggle(command: int, toggle: int) -> None:
    if command & _TOGGLE != toggle:
        raise SdoAbort(*abort_codes.TOGGLE)
