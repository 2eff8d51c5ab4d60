"""The TCP connections of the Modbus server: bounded in number, memory and patience.

Where a new one finds no room, the one goes that was never asked anything, the oldest first; then
the one that has been quiet longest, if that is long enough. Otherwise the new one is not let in. So
connections that are opened and left cannot keep out who asks (MODBUS Messaging on TCP/IP
Implementation Guide V1.0b, 4.2.2, has the oldest unused connection closed).
"""

import asyncio
import socket

from hil_bench.modbus.server_config import TlsConfig
from hil_bench.transports.modbus.framing import FramingError
from hil_bench.transports.modbus.register_server import RegisterServer
from hil_bench.transports.modbus.session import tcp_session
from hil_bench.transports.modbus.tls import may_write

QUIET_TIME = 30.0
"""Silence after which a connection may be closed to make room [s]."""

PATIENCE = 10.0
"""How long a client may leave its responses unread [s]."""

_CHUNK = 1024
_UNREAD = 16 * 1024
"""Responses that may wait for a client before it is asked nothing more [byte]."""


class ConnectionPool:
    """The connections that there are, and who may come in.

    Args:
        server: answers requests.
        limit: most connections at a time.
        tls: whose certificates may write; None where anybody may.
    """

    def __init__(self, server: RegisterServer, limit: int, tls: TlsConfig | None = None) -> None:
        self.server = server
        self.tls = tls
        self._limit = limit
        self._connections: dict[_Connection, None] = {}  # in the order of their opening

    def __len__(self) -> int:
        return len(self._connections)

    def make_connection(self) -> asyncio.BufferedProtocol:
        """Return the protocol of a new connection."""
        return _Connection(self)

    def admit(self, connection: "_Connection") -> bool:
        """Take a connection in, and return whether there was room or some could be made."""
        if len(self._connections) >= self._limit and not self._make_room():
            return False
        self._connections[connection] = None
        return True

    def forget(self, connection: "_Connection") -> None:
        """Take note that a connection is gone."""
        self._connections.pop(connection, None)

    def close(self) -> None:
        """Close all."""
        for connection in list(self._connections):
            connection.abort()

    def _make_room(self) -> bool:
        now = asyncio.get_running_loop().time()
        victim = min(
            self._connections,
            key=lambda connection: (connection.was_asked, connection.active_at),
        )
        if victim.was_asked and now - victim.active_at < QUIET_TIME:
            return False
        victim.abort()
        self.forget(victim)
        return True


class _Connection(asyncio.BufferedProtocol):
    """One client."""

    def __init__(self, pool: ConnectionPool) -> None:
        self._pool = pool
        self._chunk = bytearray(_CHUNK)
        self._loop = asyncio.get_running_loop()
        self._impatience: asyncio.TimerHandle | None = None
        self._is_reading = True
        self.active_at = self._loop.time()

    @property
    def was_asked(self) -> bool:
        """Whether a request ever came."""
        return self._session.requests > 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type alone
        self._transport = transport
        tls = self._pool.tls
        is_writer = tls is None or may_write(
            transport.get_extra_info("ssl_object"), tls.writer_role
        )
        self._session = tcp_session(self._pool.server, self._write, is_writer=is_writer)
        transport.set_write_buffer_limits(high=_UNREAD)
        # Or the kernel would keep megabytes for a client that does not read.
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD)
        if not self._pool.admit(self):
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        self._pool.forget(self)
        if self._impatience is not None:
            self._impatience.cancel()

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - asyncio's
        return self._chunk

    def buffer_updated(self, nbytes: int) -> None:
        self.active_at = self._loop.time()
        try:
            self._session.receive(memoryview(self._chunk)[:nbytes])
        except FramingError:
            self.abort()
            return
        self._hold_back()

    def pause_writing(self) -> None:
        self._impatience = self._loop.call_later(PATIENCE, self.abort)
        self._hold_back()

    def resume_writing(self) -> None:
        if self._impatience is not None:
            self._impatience.cancel()
            self._impatience = None
        self._hold_back()

    def abort(self) -> None:
        """Close at once, whatever is unsent."""
        self._transport.abort()

    def _write(self, response: bytes) -> None:
        if self._transport.is_closing():
            return
        self._transport.write(response)
        self._hold_back()

    def _hold_back(self) -> None:
        """Read on only while responses are read and writes are obeyed."""
        if self._transport.is_closing():
            return
        may_read = self._impatience is None and not self._session.is_full
        if may_read != self._is_reading:
            self._is_reading = may_read
            change = self._transport.resume_reading if may_read else self._transport.pause_reading
            change()
