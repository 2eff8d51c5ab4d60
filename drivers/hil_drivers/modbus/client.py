"""A Modbus client in the caller's thread: one request, one response.

A link that is lost is opened again with the next request, but not before a back-off that doubles
from `FIRST_BACKOFF` to `LAST_BACKOFF`; a request before that is refused at once, so that a control
loop is not held up. Time is the caller's clock, and passes in the link only: so the same code runs
in real time and on the embedded bench in virtual time.
"""

import struct
import time
from collections.abc import Callable, Sequence
from typing import Self

from hil_drivers.errors import (
    BusLostError,
    DriverTimeoutError,
    ModbusExceptionError,
    RemoteProtocolError,
)
from hil_drivers.modbus.links import Link

FIRST_BACKOFF, LAST_BACKOFF = 0.05, 5.0
"""Shortest and longest time between two attempts to open a link that was lost [s]."""

_LONGEST_BUFFER = 1024

_READ_COILS, _READ_DISCRETE_INPUTS, _READ_HOLDING, _READ_INPUT = 1, 2, 3, 4
_WRITE_COIL, _WRITE_REGISTERS = 5, 16
_IDENTIFICATION = 0x2B
_BASIC_IDENTIFICATION = bytes([_IDENTIFICATION, 0x0E, 1, 0])
_EXCEPTION_BIT = 0x80

READ_FUNCTIONS = {"input_registers": _READ_INPUT, "holding_registers": _READ_HOLDING}

_MEANINGS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledge",
    6: "server device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target device failed to respond",
}


class ModbusClient:
    """The devices behind one link.

    Args:
        link: a TCP connection or a serial line.
        clock: seconds on a clock that never steps back; the link's own where its time is virtual.
        timeout: longest wait for a response, and for a connection [s].

    Attributes:
        link: as passed in.
        timeout: as passed in; may be changed.
    """

    def __init__(
        self, link: Link, *, clock: Callable[[], float] = time.monotonic, timeout: float = 0.2
    ) -> None:
        self.link = link
        self.timeout = timeout
        self._clock = clock
        self._is_open = False
        self._backoff = 0.0
        self._retry_at = -float("inf")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def now(self) -> float:
        """Return the time on the client's clock [s]."""
        return self._clock()

    def sync(self) -> None:
        """Do nothing: Modbus devices answer when they are asked."""

    def pump_until(self, deadline: float) -> None:
        """Wait until `deadline` [s]."""
        if (remaining := deadline - self.now()) > 0:
            self.link.wait(remaining)

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:  # noqa: ARG002
        """Return True if `condition` holds: nothing comes by itself, so waiting would not help."""
        return condition()

    def close(self) -> None:
        """Close the link; the next request opens it again."""
        self.link.close()
        self._is_open = False

    def read_registers(self, unit_id: int, table: str, address: int, count: int) -> list[int]:
        """Return registers of one request, so of one moment of the device.

        Args:
            unit_id: the device.
            table: ``input_registers`` or ``holding_registers``.
            address: of the first, from 0.
            count: how many, 1 to 125.

        Raises:
            RemoteProtocolError: the response has another length.
        """
        request = struct.pack(">BHH", READ_FUNCTIONS[table], address, count)
        response = self.request(unit_id, request)
        if len(response) != 2 + 2 * count or response[1] != 2 * count:
            raise RemoteProtocolError(
                f"{self._name(unit_id)}: {len(response)} bytes for {count} registers"
            )
        return list(struct.unpack(f">{count}H", response[2:]))

    def read_bit(self, unit_id: int, table: str, address: int) -> bool:
        """Return one bit of the ``coils`` or ``discrete_inputs``.

        Raises:
            RemoteProtocolError: the response has another length.
        """
        function = _READ_COILS if table == "coils" else _READ_DISCRETE_INPUTS
        response = self.request(unit_id, struct.pack(">BHH", function, address, 1))
        if len(response) != 3 or response[1] != 1:
            raise RemoteProtocolError(f"{self._name(unit_id)}: {len(response)} bytes for one bit")
        return bool(response[2] & 1)

    def write_registers(self, unit_id: int, address: int, words: Sequence[int]) -> None:
        """Write holding registers by one request.

        Args:
            unit_id: the device.
            address: of the first, from 0.
            words: 1 to 123.
        """
        count = len(words)
        head = struct.pack(">BHHB", _WRITE_REGISTERS, address, count, 2 * count)
        self.request(unit_id, head + struct.pack(f">{count}H", *words))

    def write_coil(self, unit_id: int, address: int, *, on: bool) -> None:
        """Write one coil."""
        self.request(unit_id, struct.pack(">BHH", _WRITE_COIL, address, 0xFF00 if on else 0))

    def read_identification(self, unit_id: int) -> dict[int, str]:
        """Return the basic device identification: 0 vendor, 1 product code, 2 revision.

        Raises:
            RemoteProtocolError: the response is malformed.
        """
        response = self.request(unit_id, _BASIC_IDENTIFICATION)
        objects, position = {}, 7
        try:
            for _ in range(response[6]):
                number, length = response[position : position + 2]
                text = response[position + 2 : position + 2 + length]
                objects[number] = text.decode("latin-1")
                position += 2 + length
        except (IndexError, ValueError):
            raise RemoteProtocolError(
                f"{self._name(unit_id)}: identification {response.hex(' ')} is malformed"
            ) from None
        return objects

    def request(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request and return its response, function code first.

        `BusLostError` where the link is lost, or is not tried again yet.

        Raises:
            DriverTimeoutError: there was no response in time.
            ModbusExceptionError: the device refused.
            RemoteProtocolError: the response is for another function.
        """
        self._ensure_open()
        try:
            response = self._exchange(unit_id, pdu)
        except DriverTimeoutError:
            raise
        except OSError as error:
            raise self._lost(error) from error
        except RemoteProtocolError:
            self.close()
            raise
        self._backoff = 0.0
        if response[0] == pdu[0] | _EXCEPTION_BIT and len(response) == 2:
            code = response[1]
            meaning = _MEANINGS.get(code, "unknown")
            what = f"{self._name(unit_id)}: function {pdu[0]} refused: exception {code}, {meaning}"
            raise ModbusExceptionError(what, code)
        if response[0] != pdu[0]:
            what = f"response to function {response[0]}; {pdu[0]} was asked for"
            raise RemoteProtocolError(f"{self._name(unit_id)}: {what}")
        return response

    def _exchange(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the response.

        Raises:
            DriverTimeoutError: there was none in time.
        """
        link, buffer = self.link, bytearray()
        link.send(link.framing.wrap(unit_id, pdu))
        deadline = self.now() + self.timeout
        while (remaining := deadline - self.now()) > 0:
            buffer += link.receive(remaining)
            response = link.framing.take(buffer)
            if response:
                return response
            del buffer[:-_LONGEST_BUFFER]
        raise DriverTimeoutError(
            f"{self._name(unit_id)}: no response within {self.timeout:g} s; "
            "check unit-ID, power and link"
        )

    def _ensure_open(self) -> None:
        """Open the link where it is not.

        Raises:
            BusLostError: it cannot be opened, or it is too early to try.
        """
        if self._is_open:
            return
        early = self._retry_at - self.now()
        if early > 0:
            raise BusLostError(
                f"{self.link.description}: lost; the next attempt is in {early:.2f} s"
            )
        try:
            self.link.open(self.timeout)
        except OSError as error:
            raise self._lost(error) from error
        self._is_open = True

    def _lost(self, error: OSError) -> BusLostError:
        self.close()
        self._backoff = min(max(2 * self._backoff, FIRST_BACKOFF), LAST_BACKOFF)
        self._retry_at = self.now() + self._backoff
        reason = error.strerror or str(error) or type(error).__name__
        return BusLostError(f"{self.link.description}: {reason}")

    def _name(self, unit_id: int) -> str:
        return f"unit {unit_id} at {self.link.description}"
