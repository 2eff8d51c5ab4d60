"""Modbus frames as a client sends and receives them.

Written apart from the bench's server, so that the two do not share a mistake. Sources: MODBUS
Messaging on TCP/IP Implementation Guide V1.0b, 3.1.3; MODBUS over Serial Line V1.02, 2.5.1.
"""

import struct
from typing import Protocol

from hil_drivers.errors import RemoteProtocolError

_HEADER = struct.Struct(">HHHB")
_EXCEPTION_BIT = 0x80
_IDENTIFICATION = 0x2B


class Framing(Protocol):
    """The framing of requests, and the search for their responses in the received bytes."""

    def wrap(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the frame of a new request."""

    def take(self, buffer: bytearray) -> bytes | None:
        """Remove the response to the last request and return its PDU; None while it lacks."""


class TcpFraming:
    """Frames on TCP; a response of an earlier request, which came too late, is passed over."""

    def __init__(self) -> None:
        self._transaction = 0
        self._unit_id = 0

    def wrap(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the frame of a new request."""
        self._transaction = self._transaction + 1 & 0xFFFF
        self._unit_id = unit_id
        return _HEADER.pack(self._transaction, 0, len(pdu) + 1, unit_id) + pdu

    def take(self, buffer: bytearray) -> bytes | None:
        """Remove the response to the last request and return its PDU; None while it lacks.

        Raises:
            RemoteProtocolError: what came is no Modbus frame.
        """
        while len(buffer) > _HEADER.size:
            transaction, protocol, length, unit_id = _HEADER.unpack_from(buffer)
            if protocol != 0 or not 2 <= length <= 254:
                raise RemoteProtocolError(
                    f"header {buffer[:7].hex(' ')} is not a Modbus TCP header"
                )
            end = _HEADER.size - 1 + length
            if len(buffer) < end:
                return None
            pdu = bytes(buffer[_HEADER.size : end])
            del buffer[:end]
            if (transaction, unit_id) == (self._transaction, self._unit_id):
                return pdu
        return None


class RtuFraming:
    """Frames on a serial line."""

    def __init__(self) -> None:
        self._unit_id = 0
        self._function = 0

    def wrap(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the frame of a new request."""
        self._unit_id, self._function = unit_id, pdu[0]
        body = bytes([unit_id]) + pdu
        return body + check_sum(body)

    def take(self, buffer: bytearray) -> bytes | None:
        """Remove the response to the last request and return its PDU; None while it lacks.

        Bytes before it are noise, or a response to a request that somebody has given up.
        """
        for start in range(len(buffer) - 4):
            function = buffer[start + 1] & ~_EXCEPTION_BIT
            if (buffer[start], function) != (self._unit_id, self._function):
                continue
            end = start + _response_length(buffer[start:])
            if end == start or end > len(buffer):
                continue
            if check_sum(buffer[start : end - 2]) == buffer[end - 2 : end]:
                pdu = bytes(buffer[start + 1 : end - 2])
                del buffer[:end]
                return pdu
        return None


def check_sum(data: bytes | bytearray) -> bytes:
    """Return the CRC of a frame, low byte first as it is sent."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


def _response_length(frame: bytearray) -> int:
    """Return the length of a response frame [byte]; 0 while it is not known."""
    function = frame[1]
    if function & _EXCEPTION_BIT:
        return 5
    if function <= 4:
        return frame[2] + 5
    if function != _IDENTIFICATION:
        return 8
    if len(frame) < 8:
        return 0
    end = 8
    for _ in range(frame[7]):
        if len(frame) < end + 2:
            return 0
        end += 2 + frame[end + 1]
    return end + 2
