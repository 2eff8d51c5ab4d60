"""The interface of a bus to the bench, and a bus on which nothing happens."""

import select
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError

# The interface of a bus to the bench.

HUB_PORT: Final = 29536
"""The port of a hub, socketcand's own."""

PATIENCE: Final = 0.1
"""Longest wait for a frame of who has nothing else to do, before it looks at its own end [s]."""

FRAMES_AT_ONCE: Final = 64
"""Most frames that it takes from the bus before the bus is asked again."""


@dataclass(slots=True)
class TransportCounters:
    """Counts of frames that passed a transport since it was opened.

    Attributes:
        received: handed to the bench.
        sent: taken by the bus.
        ignored: received, but no data or remote frame that the bus has: error frames, and CAN FD
            on a classical bus.
        dropped: lost by the kernel because its receive buffer was full.
        send_failures: given up, since the bus did not take them.
        outages: how often the interface went down.
        is_down: whether it is down now.
        bits: that the frames received and sent took on the bus, with half of the most stuff bits;
            what the bus's filters keep from the bench is not in it.
    """

    received: int = 0
    sent: int = 0
    ignored: int = 0
    dropped: int = 0
    send_failures: int = 0
    outages: int = 0
    is_down: bool = False
    bits: float = field(default=0.0, compare=False)  # an estimate


class Transport(Protocol):
    """One CAN bus, read and written by one thread, which blocks in `wait` alone."""

    @property
    def description(self) -> str:
        """The bus in words: "socketcan vcan0"."""

    @property
    def has_exact_wait(self) -> bool:
        """Return True if `wait` ends on time to some 10 us: a paced loop may sleep in it."""

    def receive(self, limit: int) -> list[Frame]:
        """Return at most `limit` frames that have arrived, in order; the rest waits.

        Raises:
            BusError: the bus is lost.
        """

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived, at most `timeout` [s]; return whether one has.

        A signal that the process handles may end the wait early.

        Raises:
            BusError: the bus is lost.
        """

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order; what the bus does not take is retried, then counted as failed.

        Raises:
            BusError: the bus is lost.
        """

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Let frames with these 11-bit identifiers through, and as few others as the bus can.

        Where there are several buses, they are as `frame.address_of` has them.

        Where the bus has no filters, all frames still arrive.

        Raises:
            BusError: the bus is lost.
        """

    def counters(self) -> TransportCounters:
        """Return the counters so far."""

    def close(self) -> None:
        """Release the bus; a second call does nothing."""


def outage_at_end(transport: Transport) -> BusError | None:
    """Return the error of a run whose interface is down at its end, None where it is up."""
    if not transport.counters().is_down:
        return None
    return BusError(f"{transport.description}: the interface was down at the end")


# Waiting for a socket.

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
