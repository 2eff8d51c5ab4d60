"""The process of the Modbus server, and its serial line."""

import asyncio
import contextlib
import errno
import logging
import os
import sys
import termios
import time
import tty
from collections.abc import Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import NamedTuple, Protocol, Self

from hil_bench.abilities.modbus.protocol.mailbox import Mailbox
from hil_bench.abilities.modbus.protocol.register_map import Parity, SerialConfig, ServerConfig
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage
from hil_bench.abilities.modbus.server.connections import Complaints, ConnectionPool
from hil_bench.abilities.modbus.server.register_server import RegisterServer, RowSource
from hil_bench.abilities.modbus.server.session import serial_session
from hil_bench.errors import BusError
from hil_bench.outside.processes.helper_process import ChildProcess
from hil_bench.outside.reception import say_errors_in_a_line, serve_at

# The Modbus server in a process of its own: nothing a client does can hold a tick up.
#
# A server that died can be started again: the orders and the values are in shared memory, which
# is the loop's. Clients find the new one at the same TCP port.

_POLL = 0.0005
"""Time between two looks for the loop's answer to a write [s]."""
_WATCH = 0.1
"""Time between two looks whether the loop lives [s]."""
_REASONS = {
    errno.EADDRINUSE: "the port is in use; give another port, or end the program that has it",
    errno.EACCES: "ports below 1024 are for root; give another port",
    errno.EADDRNOTAVAIL: "this machine has no such address; give 127.0.0.1 or one that it has",
}


class Plan(Protocol):
    """The plan of a server's process: its address, its units and its data."""

    @property
    def server(self) -> ServerConfig:
        """The configuration of its address."""

    @property
    def units(self) -> Mapping[int, UnitImage]:
        """The units by unit-ID."""

    @property
    def rows(self) -> RowSource:
        """The source of the values."""

    @property
    def mailbox(self) -> Mailbox:
        """The destination of writes."""


class Endpoints(NamedTuple):
    """The end points at which clients find the server.

    Attributes:
        port: TCP port, None where it is not on TCP.
        serial_port: device file of the serial line, None where there is none.
    """

    port: int | None
    serial_port: str | None


class ModbusProcess:
    """A running server, as a context manager.

    It ends with the `with` block, and when its parent process dies; Ctrl-C is left to the parent.

    Args:
        plan: what it serves, and where.

    Attributes:
        endpoints: where clients find it, within the `with` block.
    """

    def __init__(self, plan: Plan) -> None:
        self.endpoints = Endpoints(None, None)
        self._plan = plan
        self._child = self._make_child(plan.server)

    @property
    def alive(self) -> bool:
        """Return True if the process runs."""
        return self._child.alive

    @property
    def pid(self) -> int | None:
        """Its process-ID, None before it runs."""
        return self._child.pid

    def ending(self) -> str | None:
        """Describe how the process ended, as in "was killed (SIGKILL)"; None while it runs."""
        return self._child.ending()

    def __enter__(self) -> Self:
        """Start the process and wait until clients may connect; `BusError` where none can."""
        self.endpoints = Endpoints(*self._child.start())
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()

    def restart(self) -> None:
        """Start the server again after its process has ended, and wait until clients may connect.

        It listens on the TCP port that it had; a pseudo-terminal is a new one, see `endpoints`. A
        write that the loop had not answered stays an order, and is obeyed at most once; its client
        lost the connection. `BusError` where the server cannot serve.
        """
        self._child.stop()
        port, config = self.endpoints.port, self._plan.server
        self._child = self._make_child(config if port is None else replace(config, port=port))
        self.endpoints = Endpoints(*self._child.start())

    def _make_child(self, config: ServerConfig) -> ChildProcess:
        plan = self._plan
        level = logging.getLogger().getEffectiveLevel()
        return ChildProcess(
            _run,
            (config, plan.units, plan.rows, plan.mailbox, level),
            name="hil-bench-modbus",
            label="modbus",
        )


def _run(
    config: ServerConfig,
    units: Mapping[int, UnitImage],
    rows: RowSource,
    mailbox: Mailbox,
    level: int,
    connection: Connection,
) -> None:
    """Serve in this process, which is the child; tell the parent where, or why not."""
    clear = "\r\x1b[J" if sys.stderr.isatty() else ""  # the status line, which is drawn again
    logging.basicConfig(level=level, format=f"{clear}hil-bench: %(message)s")
    mailbox.resume()
    server = RegisterServer(units, rows, mailbox, time.monotonic, default_unit=config.default_unit)
    try:
        asyncio.run(serve(config, server, connection))
    except BusError as error:
        connection.send(str(error))


async def serve(config: ServerConfig, server: RegisterServer, connection: Connection) -> None:
    """Serve until the process ends; `BusError` where a port is not free."""
    say_errors_in_a_line("modbus server")
    pool = ConnectionPool(server, config.connections, config.tls)
    port = await _listen(config, pool) if config.is_on_tcp else None
    connection.send((port, _open_line(config.serial, server) if config.serial else None))
    write_waits = asyncio.Event()
    server.on_wait = write_waits.set
    while True:
        server.poll()
        if server.is_waiting:
            await asyncio.sleep(_POLL)
            continue
        write_waits.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(write_waits.wait(), _WATCH)


def _open_line(config: SerialConfig, server: RegisterServer) -> str:
    """Serve the serial line and return its device file."""
    return SerialLine(config, server).name


async def _listen(config: ServerConfig, pool: ConnectionPool) -> int:
    """Listen on TCP and return the port.

    Raises:
        BusError: the port is not free, or not allowed.
    """
    try:
        listener = await serve_at(pool.make_connection, config.host, config.port)
    except OSError as error:
        # From Python 3.13 on, asyncio gives no number where the machine lacks every address.
        number = error.errno or errno.EADDRNOTAVAIL
        reason = _REASONS.get(number, f"cannot be opened: {error.strerror or error}")
        raise BusError(f"modbus {config.host}:{config.port}: {reason}") from None
    port: int = listener.sockets[0].getsockname()[1]
    return port


# The serial line of the Modbus server: a port, or a new pseudo-terminal.
#
# A port that is lost (its adapter was pulled out) is tried again each `RETRY` seconds. The line
# has no connection to close: after an error it goes on with the next frame.

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
