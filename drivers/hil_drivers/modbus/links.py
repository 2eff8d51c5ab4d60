"""The ways to a Modbus device: TCP, and a serial line.

A link carries bytes and raises an `OSError` where it is lost; `ModbusClient` does the rest.
"""

import contextlib
import select
import socket
import ssl
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hil_drivers.modbus.framing import Framing, RtuFraming, TcpFraming

if TYPE_CHECKING:
    from serial import Serial

try:
    import termios

    _REFUSALS: tuple[type[Exception], ...] = (ValueError, termios.error)
except ImportError:  # not POSIX, where pyserial has no such error
    _REFUSALS = (ValueError,)

DEFAULT_PORT = 502
DEFAULT_TLS_PORT = 802
_CHUNK = 1024


class Link(Protocol):
    """A link that carries bytes to and from devices."""

    description: str
    """How messages name it."""

    framing: Framing
    """How frames stand on it."""

    def open(self, timeout: float) -> None:
        """Open it, within `timeout` seconds; `OSError` where that fails."""

    def close(self) -> None:
        """Close it; it may be opened again."""

    def send(self, data: bytes) -> None:
        """Send, and forget what was received and not taken; `OSError` where it is lost."""

    def receive(self, timeout: float) -> bytes:
        """Return the bytes received within `timeout` seconds; `OSError` where the link is lost."""

    def wait(self, duration: float) -> None:
        """Let time pass [s]."""


class TcpLink:
    """A TCP connection.

    Args:
        host: name or address of the device.
        port: 502 is Modbus' own.
    """

    def __init__(self, host: str, port: int = DEFAULT_PORT) -> None:
        self.description = f"{host}:{port}"
        self.framing: Framing = TcpFraming()
        self._address = (host, port)
        self._socket: socket.socket | None = None

    def open(self, timeout: float) -> None:
        """Connect, within `timeout` seconds; `OSError` where that fails."""
        self._socket = socket.create_connection(self._address, timeout)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """End the connection."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def send(self, data: bytes) -> None:
        """Send; `OSError` where the connection is lost."""
        self._connected().sendall(data)

    def receive(self, timeout: float) -> bytes:
        """Return the bytes received within `timeout` seconds; empty without any.

        Raises:
            ConnectionResetError: the device has ended the connection.
        """
        connected = self._connected()
        connected.settimeout(max(timeout, 1e-6))
        try:
            data = connected.recv(_CHUNK)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError("the device has ended the connection")
        return data

    def wait(self, duration: float) -> None:
        """Let time pass [s]."""
        time.sleep(max(duration, 0.0))

    def _connected(self) -> socket.socket:
        """Return the socket.

        Raises:
            ConnectionError: there is none.
        """
        if self._socket is None:
            raise ConnectionError("not connected")
        return self._socket


class TlsLink(TcpLink):
    """A TCP connection by Modbus/TCP Security: TLS with certificates on both sides.

    Args:
        host: name or address of the device; its certificate must be for it.
        port: 802 is Modbus/TCP Security's own.
        certificate: ours, PEM; a role in it may allow us to write.
        key: of our certificate, PEM, without a password.
        ca: the authorities that the device's certificate must come from, PEM.

    Raises:
        OSError: a file cannot be read.
        ssl.SSLError: a file holds something else.
    """

    def __init__(
        self,
        host: str,
        port: int = DEFAULT_TLS_PORT,
        *,
        certificate: Path | str,
        key: Path | str,
        ca: Path | str,
    ) -> None:
        super().__init__(host, port)
        self._host = host
        self._context = ssl.create_default_context(cafile=ca)
        self._context.minimum_version = ssl.TLSVersion.TLSv1_2
        self._context.load_cert_chain(certificate, key)

    def open(self, timeout: float) -> None:
        """Connect, within `timeout` seconds.

        Raises:
            OSError: that fails, or a certificate is refused.
        """
        super().open(timeout)
        plain = self._connected()
        try:
            self._socket = self._context.wrap_socket(plain, server_hostname=self._host)
        except OSError:
            self.close()
            raise


class SerialLink:
    """A serial line, by pyserial.

    Args:
        port: as in ``/dev/ttyUSB0``.
        baud_rate: bit rate [bit/s].
        parity: ``E``, ``O`` or ``N``; a pseudo-terminal has none.
        stop_bits: 1 or 2.
    """

    def __init__(
        self, port: str, *, baud_rate: int = 19200, parity: str = "E", stop_bits: int = 1
    ) -> None:
        self.description = port
        self.framing: Framing = RtuFraming()
        self._settings: dict[str, Any] = {
            "baudrate": baud_rate,
            "parity": parity,
            "stopbits": stop_bits,
        }
        self._serial: Serial | None = None

    def open(self, timeout: float) -> None:  # noqa: ARG002 - a port opens at once or not at all
        """Open the port; `OSError` where that fails."""
        import serial  # noqa: PLC0415 - only who has a serial line needs it

        with _as_os_error():
            self._serial = serial.Serial(self.description, timeout=0, **self._settings)

    def close(self) -> None:
        """Close the port."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def send(self, data: bytes) -> None:
        """Send, and forget what was received and not taken."""
        port = self._opened()
        with _as_os_error():
            port.reset_input_buffer()
            port.write(data)

    def receive(self, timeout: float) -> bytes:
        """Return the bytes received within `timeout` seconds; empty without any."""
        port = self._opened()
        ready, _, _ = select.select([port], [], [], max(timeout, 0.0))
        return bytes(port.read(_CHUNK)) if ready else b""

    def wait(self, duration: float) -> None:
        """Let time pass [s]."""
        time.sleep(max(duration, 0.0))

    def _opened(self) -> "Serial":
        """Return the port.

        Raises:
            ConnectionError: it is not open.
        """
        if self._serial is None:
            raise ConnectionError("not open")
        return self._serial


@contextlib.contextmanager
def _as_os_error() -> Iterator[None]:
    """Make what pyserial lets through of the terminal's errors, and of wrong settings, an OSError.

    Yields:
        Nothing.

    Raises:
        OSError: the terminal refused.
    """
    try:
        yield
    except _REFUSALS as error:
        raise OSError(f"the port refuses its settings: {error}") from error
