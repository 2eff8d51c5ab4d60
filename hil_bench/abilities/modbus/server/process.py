"""The Modbus server in a process of its own: nothing a client does can hold a tick up.

A server that died can be started again: the orders and the values are in shared memory, which is
the loop's. Clients find the new one at the same TCP port.
"""

import asyncio
import contextlib
import errno
import logging
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import NamedTuple, Protocol, Self

from hil_bench.abilities.common.child_process import ChildProcess
from hil_bench.abilities.common.reception import say_errors_in_a_line, serve_at
from hil_bench.abilities.modbus.protocol.mailbox import Mailbox
from hil_bench.abilities.modbus.protocol.register_map import SerialConfig, ServerConfig
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage
from hil_bench.abilities.modbus.server.connections import ConnectionPool
from hil_bench.abilities.modbus.server.register_server import RegisterServer, RowSource
from hil_bench.errors import BusError

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
    from hil_bench.abilities.modbus.server.serial_line import SerialLine  # noqa: PLC0415 - POSIX alone

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
