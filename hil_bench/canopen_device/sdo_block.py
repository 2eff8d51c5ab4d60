"""SDO block transfers (CiA 301, SDO block download and upload).

A block transfer moves sub-blocks of up to 127 segments, numbered from 1, with one confirmation for
each sub-block. The confirmation names the last segment that came in order; what follows it is sent
again, as the beginning of the next sub-block. Bit 7 of a segment marks the last one of all. The end
carries a CRC over the data: CRC-CCITT, polynomial 0x1021, initial value 0.
"""

import struct
from binascii import crc_hqx
from collections.abc import Iterable
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.sdo_transfer import (
    SEGMENT,
    SEGMENT_BYTES,
    TIME_OUT,
    Multiplexer,
    Transfer,
    Write,
    check_bound,
    check_complete,
)

BLOCK_SIZE: Final = 127
"""Segments that the server takes in a sub-block, and the most that there may be."""
SEGMENTS_PER_ROUND: Final = 8
"""Segments that the server sends in one round: what a bus of 1 Mbit/s carries in 1 ms."""

_PATIENCE: Final = TIME_OUT // 2
"""Longest wait for the next segment of a sub-block [ns]."""

_ABORT: Final = 0x80
_LAST: Final = 0x80
_NUMBER: Final = 0x7F

_DOWNLOAD_END: Final = 0xC1
_DOWNLOAD_CONFIRMATION: Final = 0xA2
_DOWNLOAD_END_CONFIRMATION: Final = 0xA1

_UPLOAD: Final = 5
_UPLOAD_END: Final = 1
_UPLOAD_CONFIRMATION: Final = 2
_UPLOAD_START: Final = 3
_UPLOAD_END_RESPONSE: Final = 0xC1

_NUMBERS: Final = [bytes([number]) for number in range(1, BLOCK_SIZE + 1)]
"""The first byte of the segments of a sub-block, but for that of the last segment of all."""

_END: Final = struct.Struct("<BH5x")
_CONFIRMATION: Final = struct.Struct("<BBB5x")


class BlockDownload(Transfer):
    """A download in sub-blocks.

    Where segments came, and then nothing for half the time-out, the end of the sub-block was lost:
    what came is confirmed, so that the client sends the rest again.
    """

    def __init__(
        self,
        target: Multiplexer,
        write: Write,
        announced: int | None,
        limit: int,
        now: int,
        *,
        has_crc: bool,
    ) -> None:
        """Begin.

        Args:
            target: its object.
            write: takes the data when they are complete.
            announced: length that the client told [byte], None where it told none.
            limit: longest that the object may be [byte].
            now: the time [ns].
            has_crc: whether the client sends a CRC at the end.
        """
        super().__init__(target, now)
        self._write = write
        self._announced = announced
        self._limit = limit if announced is None else announced
        self._has_crc = has_crc
        self._data = bytearray()
        self._segments: list[bytes] = []
        self._acknowledged = 0
        self._absorbable = 0
        self._is_complete = False
        self._is_within = False

    def owns(self, command: int) -> bool:
        """Return True if the frame is a segment, or the end after the last one.

        While segments come, every command byte is a segment's, but for that of an abort.
        """
        if self._is_complete:
            return command & 0xE3 == _DOWNLOAD_END
        return command != _ABORT

    def absorb(self, request: bytes, now: int) -> bytes | None:
        """Take the next segment in the midst of a sub-block, in silence."""
        number = self._acknowledged + 1
        # Bit 7, the mark of the last segment of all and of an abort, makes it another number.
        if request[0] != number or number > self._absorbable:
            return None
        self._acknowledged = number
        self._segments.append(request)
        self.due = now + _PATIENCE
        return b""

    def take(self, request: bytes, now: int) -> bytes | None:  # noqa: D102 - told by the base class
        return self._finish(request) if self._is_complete else self._take_segment(request, now)

    def proceed(self, now: int) -> Iterable[bytes]:
        """Return the confirmation of the part of a sub-block that came.

        Raises:
            SdoAbort: 0504 0000, the client has gone silent.
        """
        if not self._is_within:
            raise SdoAbort(*abort_codes.TIME_OUT)
        return (self._confirm(now),)

    def _take_segment(self, request: bytes, now: int) -> bytes | None:
        self._collect_segments()
        number, is_last = request[0] & _NUMBER, bool(request[0] & _LAST)
        if not 1 <= number <= BLOCK_SIZE:
            raise SdoAbort(*abort_codes.SEQUENCE_NUMBER)
        if number == self._acknowledged + 1:
            self._acknowledged = number
            self._is_complete = is_last
            self._data += request[1:]
            # Up to 7 bytes of the last segment may be none; how many, only the end tells.
            check_bound(len(self._data) - SEGMENT_BYTES, self._limit)
        if is_last or number == BLOCK_SIZE:
            return self._confirm(now)
        self._is_within = True
        # All but the last of a sub-block, as long as they fit.
        room = (self._limit - len(self._data)) // SEGMENT_BYTES + 1
        self._absorbable = min(self._acknowledged + room, BLOCK_SIZE - 1)
        self.due = now + _PATIENCE
        return None

    def _collect_segments(self) -> None:
        """Append what was absorbed."""
        absorbed = bytearray().join(self._segments)
        del absorbed[:: SEGMENT_BYTES + 1]  # the numbers
        self._data += absorbed
        self._segments.clear()

    def _confirm(self, now: int) -> bytes:
        self._collect_segments()
        acknowledged, self._acknowledged = self._acknowledged, 0
        self._absorbable = 0
        self._is_within = False
        self.due = now + TIME_OUT
        return _CONFIRMATION.pack(_DOWNLOAD_CONFIRMATION, acknowledged, BLOCK_SIZE)

    def _finish(self, request: bytes) -> bytes:
        command, crc = _END.unpack(request)
        data = bytes(self._data[: len(self._data) - (command >> 2 & 7)])
        if self._has_crc and crc != crc_hqx(data, 0):
            raise SdoAbort(*abort_codes.CRC)
        check_bound(len(data), self._limit)
        check_complete(len(data), self._announced)
        self._write(data)
        self.is_over = True
        return _END.pack(_DOWNLOAD_END_CONFIRMATION, 0)


class BlockUpload(Transfer):
    """An upload in sub-blocks, whose size the client may change with each confirmation."""

    def __init__(self, target: Multiplexer, data: bytes, block_size: int, now: int) -> None:
        """Wait for the client's start; `SdoAbort` 0504 0002 for an impossible block size.

        Args:
            target: its object.
            data: what the client gets.
            block_size: segments in the first sub-block.
            now: the time [ns].
        """
        super().__init__(target, now)
        _check_block_size(block_size)
        self._data = data
        self._count = max(-(-len(data) // SEGMENT_BYTES), 1)
        self._padded = data.ljust(self._count * SEGMENT_BYTES, b"\0")
        self._block_size = block_size
        self._first = 0
        self._segments: list[bytes] = []
        self._sent = 0
        self._has_started = False
        self._has_ended = False

    def owns(self, command: int) -> bool:  # noqa: D102 - told by the base class
        return command >> 5 == _UPLOAD and command & 3 != 0

    def take(self, request: bytes, now: int) -> bytes | None:
        """Take the client's start, a confirmation, or the end.

        Raises:
            SdoAbort: 0504 0001 out of turn, 0504 0002 block size, 0504 0003 a segment that was
                not sent.
        """
        subcommand = request[0] & 3
        if subcommand == _UPLOAD_START and not self._has_started:
            self._has_started = True
            self._send_from(0)
            return None
        if subcommand == _UPLOAD_CONFIRMATION and self._sent:
            return self._take_confirmation(request[1], request[2], now)
        if subcommand == _UPLOAD_END and self._has_ended:
            self.is_over = True
            return None
        raise SdoAbort(*abort_codes.COMMAND_SPECIFIER)

    def proceed(self, now: int) -> Iterable[bytes]:
        """Return the next segments of the sub-block.

        Raises:
            SdoAbort: 0504 0000, the client has gone silent.
        """
        if self._sent == len(self._segments):
            raise SdoAbort(*abort_codes.TIME_OUT)
        segments = self._segments[self._sent : self._sent + SEGMENTS_PER_ROUND]
        self._sent += len(segments)
        if self._sent == len(self._segments):
            self.due = now + TIME_OUT
        return segments

    def _send_from(self, first: int) -> None:
        """Begin a sub-block with the segment `first` of all."""
        rest = self._padded[first * SEGMENT_BYTES : (first + self._block_size) * SEGMENT_BYTES]
        chunks = SEGMENT.iter_unpack(rest)
        self._segments = [
            number + chunk for number, (chunk,) in zip(_NUMBERS, chunks, strict=False)
        ]
        self._first = first
        self._sent = 0
        self.due = 0
        number = len(self._segments)
        if first + number == self._count:
            self._segments[-1] = bytes([number | _LAST]) + self._segments[-1][1:]

    def _take_confirmation(self, acknowledged: int, block_size: int, now: int) -> bytes | None:
        if acknowledged > self._sent:
            raise SdoAbort(*abort_codes.SEQUENCE_NUMBER)
        if self._first + acknowledged == self._count:
            return self._end(now)
        _check_block_size(block_size)
        self._block_size = block_size
        self._send_from(self._first + acknowledged)
        return None

    def _end(self, now: int) -> bytes:
        self._has_ended = True
        self._segments = []
        self._sent = 0
        self.due = now + TIME_OUT
        unused = self._count * SEGMENT_BYTES - len(self._data)
        return _END.pack(_UPLOAD_END_RESPONSE | unused << 2, crc_hqx(self._data, 0))


def _check_block_size(block_size: int) -> None:
    """Refuse all but 1 to 127.

    Raises:
        SdoAbort: 0504 0002.
    """
    if not 1 <= block_size <= BLOCK_SIZE:
        raise SdoAbort(*abort_codes.BLOCK_SIZE)
