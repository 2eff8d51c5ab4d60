"""SDO transfers of more than one frame (CiA 301, service data objects): segmented ones."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND
from hil_bench.errors import SdoAbort

Multiplexer = tuple[int, int]
"""Index and sub-index: which object a transfer is about."""

Write = Callable[[bytes], None]
"""Takes the whole of what was downloaded; `SdoAbort` where the object refuses it."""

TIME_OUT: Final = 1000 * MILLISECOND
"""Longest wait for the client's next frame [ns]."""

SEGMENT_BYTES: Final = 7

_DOWNLOAD_SEGMENT: Final = 0
_UPLOAD_SEGMENT: Final = 3

_TOGGLE: Final = 0x10
_LAST: Final = 0x01

_FULL_SEGMENT: Final = {toggle: bytes([toggle]) for toggle in (0, _TOGGLE)}
"""The first byte of an upload segment of 7 bytes that others follow, by its toggle bit."""


class Transfer(ABC):
    """A transfer under way.

    Attributes:
        target: its object.
        due: when `proceed` is to be called [ns].
        is_over: whether it has come to its end.
    """

    __slots__ = ("due", "is_over", "target")

    def __init__(self, target: Multiplexer, now: int) -> None:
        self.target = target
        self.due = now + TIME_OUT
        self.is_over = False

    @abstractmethod
    def owns(self, command: int) -> bool:
        """Return whether a request with this command byte belongs to the transfer."""

    @abstractmethod
    def take(self, request: bytes, now: int) -> bytes | None:
        """Take a request that belongs to the transfer and return the answer, None for silence.

        `SdoAbort` ends the transfer.
        """

    def absorb(self, request: bytes, now: int) -> bool:  # noqa: ARG002 - block downloads use it
        """Take a request that has no answer and only puts `due` off.

        Returns:
            Whether it was one; otherwise nothing has happened, and `take` is for it.
        """
        return False

    def proceed(self, now: int) -> Iterable[bytes]:  # noqa: ARG002 - block transfers use it
        """Return what the server sends by itself when `due` has come.

        Raises:
            SdoAbort: 0504 0000, the client has gone silent.
        """
        raise SdoAbort(*abort_codes.TIME_OUT)


class SegmentedUpload(Transfer):
    """An upload in segments of 7 bytes, each on request."""

    __slots__ = ("_data", "_position", "_toggle")

    def __init__(self, target: Multiplexer, data: bytes, now: int) -> None:
        super().__init__(target, now)
        self._data = data
        self._position = 0
        self._toggle = 0

    def owns(self, command: int) -> bool:  # noqa: D102 - told by the base class
        return command >> 5 == _UPLOAD_SEGMENT

    def take(self, request: bytes, now: int) -> bytes:
        """Return the next segment.

        Raises:
            SdoAbort: 0503 0000.
        """
        toggle = self._toggle
        if request[0] & _TOGGLE != toggle:
            raise SdoAbort(*abort_codes.TOGGLE)
        begin = self._position
        end = self._position = begin + SEGMENT_BYTES
        self._toggle = toggle ^ _TOGGLE
        self.due = now + TIME_OUT
        segment = self._data[begin:end]
        if end < len(self._data):
            return _FULL_SEGMENT[toggle] + segment
        self.is_over = True
        answer = toggle | (SEGMENT_BYTES - len(segment)) << 1 | _LAST
        return bytes([answer]) + segment.ljust(SEGMENT_BYTES, b"\0")


class SegmentedDownload(Transfer):
    """A download in segments of up to 7 bytes, each confirmed."""

    __slots__ = ("_announced", "_data", "_limit", "_toggle", "_write")

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

    def take(self, request: bytes, now: int) -> bytes:  # noqa: D102
        command = request[0]
        _check_toggle(command, self._toggle)
        length = SEGMENT_BYTES - (command >> 1 & 7)
        self._data += request[1 : 1 + length]
        check_bound(len(self._data), self._limit)
        answer = 0x20 | self._toggle
        self._toggle ^= _TOGGLE
        self.due = now + TIME_OUT
        if command & _LAST:
            check_complete(len(self._data), self._announced)
            self._write(bytes(self._data))
            self.is_over = True
        return bytes([answer]) + bytes(SEGMENT_BYTES)


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
