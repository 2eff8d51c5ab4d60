"""Several buses as one transport: each frame says by its number on which of them it is."""

import select
import time
from collections.abc import Iterable, Sequence
from dataclasses import fields
from operator import attrgetter

from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import BUS_SHIFT
from hil_bench.outside.transports.socketcan import SocketCanTransport
from hil_bench.outside.transports.transport import Transport, TransportCounters

_CAN_ID_MASK = (1 << BUS_SHIFT) - 1
_LOOK = 1e-3
"""How long one bus is waited for while others may have something [s]."""


class JoinedTransport:
    """The buses of a bench that has more than one.

    Frames of one bus keep their order; between buses there is none.

    Args:
        transports: the buses, two or more, in the order of their numbers.

    Attributes:
        transports: as passed in.
        description: the buses in words.
        has_exact_wait: whether all of them can be waited on exactly, together.
    """

    def __init__(self, transports: Sequence[Transport]) -> None:
        self.transports = tuple(transports)
        self.description = ", ".join(transport.description for transport in transports)
        self._sockets = [t for t in transports if isinstance(t, SocketCanTransport)]
        self.has_exact_wait = len(self._sockets) == len(self.transports) and all(
            socket.has_exact_wait for socket in self._sockets
        )
        self._first = 0

    def receive(self, limit: int) -> list[Frame]:
        """Return at most `limit` frames that have arrived; each bus may take an equal share.

        What one bus leaves of its share is for those after it; another one begins each time.
        """
        frames: list[Frame] = []
        count = len(self.transports)
        for place in range(count):
            number = (self._first + place) % count
            share = -(-(limit - len(frames)) // (count - place))
            frames += [
                frame._replace(bus=number) for frame in self.transports[number].receive(share)
            ]
        self._first = (self._first + 1) % count
        return frames

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived on any bus, at most `timeout` [s]; return whether so."""
        if self.has_exact_wait:
            return bool(select.select(self._sockets, [], [], timeout)[0])
        end = time.monotonic() + timeout
        if any(transport.wait(0.0) for transport in self.transports):
            return True
        while (remaining := end - time.monotonic()) > 0.0:
            for transport in self.transports:
                if transport.wait(min(_LOOK, remaining)):
                    return True
        return False

    def send(self, frames: Sequence[Frame]) -> None:
        """Send each frame on its bus, in order; what a bus does not take, it keeps by itself."""
        for number, transport in enumerate(self.transports):
            transport.send([frame for frame in frames if frame.bus == number])

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Let frames with these identifiers through, each on its bus: see `frame.address_of`."""
        wanted: list[list[int]] = [[] for _ in self.transports]
        for address in can_ids:
            wanted[address >> BUS_SHIFT].append(address & _CAN_ID_MASK)
        for transport, identifiers in zip(self.transports, wanted, strict=True):
            transport.listen_to(identifiers)

    def counters(self) -> TransportCounters:
        """Return the counters of all buses together; one that is down counts as down."""
        parts = [transport.counters() for transport in self.transports]
        totals = {
            item.name: sum(map(attrgetter(item.name), parts)) for item in fields(TransportCounters)
        }
        return TransportCounters(**totals | {"is_down": any(part.is_down for part in parts)})

    def close(self) -> None:
        """Release all buses."""
        for transport in self.transports:
            transport.close()
