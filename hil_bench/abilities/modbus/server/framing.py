"""Modbus frames on a stream of bytes: MBAP for TCP, address and CRC for a serial line.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3 (MBAP header); MODBUS over
Serial Line V1.02, 2.5.1 (RTU frame) and 6.2.2 (CRC).
"""

import struct
from typing import Final, NamedTuple, Protocol

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
