"""The serial line of the Modbus server: a port, or a new pseudo-terminal.

A port that is lost (its adapter was pulled out) is tried again each `RETRY` seconds. The line has
no connection to close: after an error it goes on with the next frame.
"""

import asyncio
import contextlib
import os
import termios
import tty
from typing import Protocol

from hil_bench.abilities.modbus.protocol.register_map import Parity, SerialConfig
from hil_bench.abilities.modbus.server.connections import Complaints
from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import serial_session
from hil_bench.errors import BusError

PSEUDO_TERMINAL = "pty"

RETRY = 1.0
"""Time between two attempts to open a port that was lost [s]."""

_SHORTEST_SILENCE = 0.05
_CHUNK = 1024
_BITS_PER_CHARACTER = 11
_PARITIES = {Parity.EVEN: "E", Parity.ODD: "O", Parity.NONE: "N"}


class SerialDevice(Protocol):
    """A serial device that reads and writes without waiting."""

    def fileno(self) -> int:
        """Return the descriptor."""

    def close(self) -> None:
        """Close it."""


class PseudoTerminal:
    """A new pseudo-terminal.

    Attributes:
        name: the device file that a client opens.
    """

    def __init__(self) -> None:
        # Our own copy of the client's end keeps the line up while no client has it open.
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.name = os.ttyname(self._theirs)

    def fileno(self) -> int:
        """Return the descriptor of our end."""
        return self._ours

    def close(self) -> None:
        """Close both ends."""
        os.close(self._ours)
        os.close(self._theirs)


def open_serial(config: SerialConfig) -> SerialDevice:
    """Open the line that a configuration names.

    Raises:
        BusError: the port cannot be opened.
    """
    if config.port == PSEUDO_TERMINAL:
        return PseudoTerminal()
    import serial  # noqa: PLC0415 - only who has a serial line needs it

    try:
        port: SerialDevice = serial.Serial(
            config.port,
            baudrate=config.baud_rate,
            parity=_PARITIES[config.parity],
            stopbits=config.stop_bits,
            timeout=0,
            exclusive=True,
        )
    except (OSError, ValueError, termios.error) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise BusError(
            f"modbus serial port {config.port}: cannot be opened: {reason}; "
            "give a serial port that is there and free"
        ) from None
    return port


class SerialLine:
    """The line while it is served, in the running event loop.

    Args:
        config: the port.
        server: answers requests.

    Attributes:
        name: the device file.
    """

    def __init__(self, config: SerialConfig, server: RegisterServer) -> None:
        self._config = config
        self._loop = asyncio.get_running_loop()
        self._complaints = Complaints(self._loop.time)
        self._server = server
        self._silence = max(
            3.5 * _BITS_PER_CHARACTER / config.baud_rate,
            _SHORTEST_SILENCE,
        )
        self._timer: asyncio.TimerHandle | None = None
        self._device: SerialDevice | None = None
        self._open()

    @property
    def name(self) -> str:
        """The device file that it is."""
        device = self._device
        return device.name if isinstance(device, PseudoTerminal) else self._config.port

    def close(self) -> None:
        """Serve the line no longer."""
        if self._device is not None:
            self._session.end()  # a response that is still to come was for the lost line
            self._loop.remove_reader(self._device.fileno())
            self._device.close()
            self._device = None

    def _open(self) -> None:
        self._device = open_serial(self._config)
        self._session = serial_session(self._server, self._write, on_failure=self._complain)
        self._loop.add_reader(self._device.fileno(), self._read)

    def _read(self) -> None:
        assert self._device is not None  # noqa: S101 - a closed one has no reader
        try:
            data = os.read(self._device.fileno(), _CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._lose()
            return
        self._await_silence()
        if not self._session.is_full:
            self._session.receive(data)

    def _await_silence(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_later(self._silence, self._session.drop)

    def _write(self, response: bytes) -> None:
        if self._device is not None:
            # A line that takes no more has nobody at its other end.
            with contextlib.suppress(OSError):
                os.write(self._device.fileno(), response)

    def _complain(self, reason: str) -> None:
        self._complaints.add(f"on {self.name}", reason)

    def _lose(self) -> None:
        self._complain(f"the serial port is lost; next attempt in {RETRY:g} s")
        self.close()
        self._loop.call_later(RETRY, self._retry)

    def _retry(self) -> None:
        try:
            self._open()
        except BusError:
            self._loop.call_later(RETRY, self._retry)
