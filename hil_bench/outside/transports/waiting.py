"""Waiting for a socket."""

import select
import socket

_FD_SETSIZE = 1024  # of sys/select.h


def has_exact_wait(connection: socket.socket) -> bool:
    """Return True if `select` takes the socket: it waits to the microsecond, `poll` to the ms."""
    return connection.fileno() < _FD_SETSIZE


def is_readable(connection: socket.socket, timeout: float) -> bool:
    """Wait until there is something to read, at most `timeout` [s]; return whether there is."""
    if has_exact_wait(connection):
        return bool(select.select([connection], [], [], timeout)[0])
    poll = select.poll()
    poll.register(connection, select.POLLIN)
    return bool(poll.poll(timeout * 1e3))
