"""Connections of masters by TCP and TLS, and complaints about them."""

import asyncio
import logging
import socket
import ssl
from collections.abc import Callable
from pathlib import Path
from typing import Final

from hil_bench.abilities.common.reception import capacity
from hil_bench.abilities.modbus.protocol.register_map import TlsConfig
from hil_bench.abilities.modbus.server.register_server import RegisterServer
from hil_bench.abilities.modbus.server.session import tcp_session
from hil_bench.errors import BusError

# Modbus/TCP Security: TLS with certificates on both sides, and roles that may write.
#
# Source: MODBUS/TCP Security Protocol Specification (2018): TLS 1.2 or later with mutual
# authentication; the role stands in the client's certificate, in an extension of its own, and who
# is not allowed a function gets exception 1.

ROLE_OID: Final = "1.3.6.1.4.1.50316.802.1"
"""The extension of a certificate that holds the role, a UTF8String."""

HANDSHAKE_TIME: Final = 10.0
"""How long a client may take for the TLS handshake [s]."""

_UTF8_STRING: Final = 0x0C
_SHORT_LENGTH: Final = 0x80


def server_context(config: TlsConfig) -> ssl.SSLContext:
    """Return the TLS context of the server's connections.

    Raises:
        BusError: a file cannot be read, or holds something else.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.verify_mode = ssl.CERT_REQUIRED
    _check_readable(config)
    try:
        context.load_cert_chain(config.certificate, config.key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        raise BusError(
            f"modbus TLS: {config.certificate} and {config.key} are no certificate and its key "
            f"without a password, both PEM: {_cause(error)}"
        ) from None
    try:
        context.load_verify_locations(config.client_ca)
    except ssl.SSLError as error:
        raise BusError(
            f"modbus TLS: {config.client_ca} holds no certificate in PEM: {_cause(error)}"
        ) from None
    return context


async def secure(
    transport: asyncio.Transport, protocol: asyncio.BaseProtocol, context: ssl.SSLContext
) -> asyncio.Transport:
    """Do the server's part of the TLS handshake and return the transport behind it.

    Args:
        transport: a connection that nothing was read from yet.
        protocol: takes what comes through the new transport.
        context: as of `server_context`.

    Raises:
        ConnectionError: the handshake failed; the message says why.
    """
    loop = asyncio.get_running_loop()
    try:
        secured = await loop.start_tls(
            transport,
            protocol,
            context,
            server_side=True,
            ssl_handshake_timeout=HANDSHAKE_TIME,
        )
    except OSError as error:
        raise ConnectionError(f"TLS handshake failed: {_cause(error)}") from None
    if secured is None:  # closed by the client, by TCP's own means
        raise ConnectionError("TLS handshake failed: the client closed the connection")
    return secured


def may_write(connection: ssl.SSLObject, writer_role: str) -> bool:
    """Return True if the client's certificate gives it the role that may write."""
    certificate = connection.getpeercert(binary_form=True)
    return certificate is not None and role_of(certificate) == writer_role


def role_of(certificate: bytes) -> str | None:
    """Return the role in a certificate [DER]; None where there is none that can be read."""
    from cryptography import x509  # noqa: PLC0415 - slow to import, and for TLS alone

    oid = x509.ObjectIdentifier(ROLE_OID)
    try:
        extension = x509.load_der_x509_certificate(certificate).extensions.get_extension_for_oid(
            oid
        )
    except (ValueError, x509.ExtensionNotFound, x509.DuplicateExtension):
        return None
    value = extension.value.public_bytes()
    if len(value) < 2 or value[0] != _UTF8_STRING or value[1] != len(value) - 2:
        return None
    if value[1] >= _SHORT_LENGTH:
        return None
    try:
        return value[2:].decode()
    except UnicodeDecodeError:
        return None


def _check_readable(config: TlsConfig) -> None:
    for path in (config.certificate, config.key, config.client_ca):
        try:
            Path(path).open("rb").close()
        except OSError as error:
            raise BusError(f"modbus TLS: {path}: cannot be read: {error.strerror}") from None


def _no_password() -> str:
    """Refuse to ask on a terminal.

    Raises:
        ValueError: always.
    """
    raise ValueError("the key has a password")


def _cause(error: Exception) -> str:
    return getattr(error, "reason", None) or str(error) or "the connection was closed meanwhile"


# Log lines about bad clients: one each, limited to a readable number.

logger = logging.getLogger(__name__)

INTERVAL = 1.0
"""Shortest time between two lines [s]."""


class Complaints:
    """Logs errors of clients, at most one line each `INTERVAL`.

    Args:
        clock: seconds that never step back.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._unsaid = 0
        self._quiet_until = -float("inf")

    def add(self, peer: str, reason: str) -> None:
        """Log the error of a client, or count it where there was a line just now."""
        now = self._clock()
        if now < self._quiet_until:
            self._unsaid += 1
            return
        more = f" ({self._unsaid} more errors since the last line)" if self._unsaid else ""
        logger.warning("modbus client %s: %s%s", peer, reason, more)
        self._unsaid = 0
        self._quiet_until = now + INTERVAL


# The TCP connections of the Modbus server: bounded in number, memory and patience.
#
# Where a new one finds no room, the one goes that was never asked anything, the oldest first;
# then the one that has been quiet longest, if that is long enough. Otherwise the new one is not
# let in. So connections that are opened and left cannot keep out who asks (MODBUS Messaging on
# TCP/IP Implementation Guide V1.0b, 4.2.2, has the oldest unused connection closed).
#
# An error in a connection closes that connection. Its reason and the client's address are logged.

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

    Attributes:
        server: as passed in.
        complaints: takes the reason of each connection that an error closed.
        context: what TLS connections are opened with; None for plain TCP.
        writer_role: the role that may write; None where everybody may.
    """

    def __init__(self, server: RegisterServer, limit: int, tls: TlsConfig | None = None) -> None:
        self.server = server
        self.complaints = Complaints(asyncio.get_running_loop().time)
        self.context = None if tls is None else server_context(tls)
        self.writer_role = None if tls is None else tls.writer_role
        self._limit = sum(capacity(limit, room=0))
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
        self._handshake: asyncio.Task[None] | None = None
        self._early = bytearray()  # came with the end of the handshake, before we hear of that
        self._is_reading = True
        self._is_half_closed = False
        self._is_aborted = False
        self._session = tcp_session(pool.server, self._write, on_failure=self._fail)
        self.active_at = self._loop.time()

    @property
    def was_asked(self) -> bool:
        """Return True if a request ever came."""
        return self._session.requests > 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - for the type alone
        self._transport = transport
        self._peer = _address(transport)
        if not self._pool.admit(self):
            transport.abort()
        elif self._pool.context is None:
            self._begin()
        else:
            transport.pause_reading()
            self._handshake = self._loop.create_task(self._shake_hands())

    def connection_lost(self, exc: Exception | None) -> None:
        if exc is not None and not self._is_aborted:
            self._complain(f"lost: {_reason(exc)}")
        self._session.end()
        self._pool.forget(self)
        if self._impatience is not None:
            self._impatience.cancel()

    def get_buffer(self, sizehint: int) -> bytearray:  # noqa: ARG002 - asyncio's
        return self._chunk

    def buffer_updated(self, nbytes: int) -> None:
        self.active_at = self._loop.time()
        data = memoryview(self._chunk)[:nbytes]
        if self._handshake is not None and not self._handshake.done():
            self._early += data
            return
        self._session.receive(data)
        self._hold_back()

    def eof_received(self) -> bool:
        """Keep open, for the responses, what the client has closed for its requests."""
        self._is_half_closed = not self._session.is_idle and self._pool.context is None
        return self._is_half_closed

    def pause_writing(self) -> None:
        self._impatience = self._loop.call_later(PATIENCE, self._lose_patience)
        self._hold_back()

    def resume_writing(self) -> None:
        if self._impatience is not None:
            self._impatience.cancel()
            self._impatience = None
        self._hold_back()

    def abort(self) -> None:
        """Close at once, whatever is unsent."""
        self._is_aborted = True
        self._session.end()
        self._transport.abort()

    async def _shake_hands(self) -> None:
        context, role = self._pool.context, self._pool.writer_role
        assert context is not None  # noqa: S101 - for the type alone
        assert role is not None  # noqa: S101 - likewise
        try:
            self._transport = await secure(self._transport, self, context)
            is_writer = may_write(self._transport.get_extra_info("ssl_object"), role)
        except Exception as error:  # whatever a certificate can do to those who read it
            self._fail(str(error))
            self._pool.forget(self)
            return
        self._session.is_writer = is_writer
        self._begin()
        self._session.receive(self._early)
        self._early.clear()
        self._hold_back()

    def _begin(self) -> None:
        self._transport.set_write_buffer_limits(high=_UNREAD)
        # Or the kernel would keep megabytes for a client that does not read.
        connection = self._transport.get_extra_info("socket")
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD)
        except OSError as error:
            self._fail(_reason(error))

    def _write(self, response: bytes) -> None:
        if self._transport.is_closing():
            return
        self._transport.write(response)
        self._hold_back()
        if self._is_half_closed:
            self._loop.call_soon(self._close_when_done)

    def _close_when_done(self) -> None:
        if self._session.is_idle:
            self._transport.close()

    def _hold_back(self) -> None:
        """Read on only while responses are read and writes are obeyed."""
        if self._transport.is_closing() or self._is_half_closed:
            return
        may_read = self._impatience is None and not self._session.is_full
        if may_read != self._is_reading:
            self._is_reading = may_read
            change = self._transport.resume_reading if may_read else self._transport.pause_reading
            change()

    def _lose_patience(self) -> None:
        self._fail(f"its responses were unread for {PATIENCE:g} s")

    def _fail(self, reason: str) -> None:
        """Close the connection because of an error."""
        if not self._is_aborted:
            self._complain(f"closed: {reason}")
            self.abort()

    def _complain(self, reason: str) -> None:
        self._pool.complaints.add(self._peer, reason)


def _address(transport: asyncio.BaseTransport) -> str:
    peer = transport.get_extra_info("peername")
    return "a client that is gone" if peer is None else f"{peer[0]}:{peer[1]}"


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
