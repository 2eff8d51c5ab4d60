"""The door of a server: who may wait there, for how long, and how many in all.

A connection is in the waiting room until it has said what it is there for. It has a short time for
that, and where one more comes than there is room for, the oldest of them goes. So connections that
say nothing, or never finish what they begin, keep nobody out. Who has a seat keeps it, however
silent.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Hashable
from typing import Any, Generic, NamedTuple, TypeVar

logger = logging.getLogger(__name__)

PATIENCE = 5.0
"""Longest time in a waiting room [s]."""

ROOM = 256
"""Most that wait at a time: enough that one who is about to speak is not the oldest before, however
fast others come."""

QUEUE = 1024
"""Connections that the kernel keeps for us until they are accepted."""

_AT_ONCE = 4
"""Connections accepted in a row, so that those before them are seen to first."""

_OWN_FILES = 32
"""Files that a server's process has open for other things than its clients, and a few to spare."""

_LEAST = 4
_SAID_AGAIN = 10.0  # shortest time between two lines on one kind of error [s]

Guest = TypeVar("Guest", bound=Hashable)


class Capacity(NamedTuple):
    """The number of connections that a server may have.

    Attributes:
        seats: of those that have said what they are there for.
        room: of the waiting room.
    """

    seats: int
    room: int


def capacity(seats: int, room: int = ROOM) -> Capacity:
    """Return the capacity that is wanted, or less where the process may not open so many files."""
    free = _most_files() - _OWN_FILES
    if free >= seats + room:
        return Capacity(seats, room)
    room = min(room, max(_LEAST, free // 3))
    return Capacity(max(_LEAST, min(seats, free - room)), room)


class WaitingRoom(Generic[Guest]):
    """Connections that have not said yet what they are there for, in the order of their coming.

    Args:
        dismiss: closes the connection of one that goes.
        room: most that wait at a time.
        patience: longest time that one waits [s].
        clock: the time [s].
    """

    def __init__(
        self,
        dismiss: Callable[[Guest], None],
        room: int = ROOM,
        patience: float = PATIENCE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._dismiss = dismiss
        self._room = room
        self._patience = patience
        self._clock = clock
        self._until: dict[Guest, float] = {}

    def __len__(self) -> int:
        return len(self._until)

    def enter(self, guest: Guest) -> None:
        """Let one in; who has waited longest makes room."""
        self.leave(guest)
        if len(self._until) >= self._room:
            self.dismiss_oldest()
        self._until[guest] = self._clock() + self._patience

    def leave(self, guest: Guest) -> None:
        """Forget one that is gone, or has a seat."""
        self._until.pop(guest, None)

    def look(self) -> None:
        """Dismiss those that have waited too long."""
        now = self._clock()
        while self._until and next(iter(self._until.values())) <= now:
            self.dismiss_oldest()

    def dismiss_oldest(self) -> None:
        """Dismiss the one that has waited longest."""
        guest = next(iter(self._until))
        self.leave(guest)
        self._dismiss(guest)


async def watch_over(*rooms: WaitingRoom[Any]) -> None:
    """Look after waiting rooms, for ever."""
    while True:
        await asyncio.sleep(PATIENCE / 10)
        for room in rooms:
            room.look()


def say_errors_in_a_line(server: str) -> None:
    """Have the running loop say in one line, now and then, what fails beside all connections.

    Args:
        server: its name.
    """
    said_at: dict[str, float] = {}

    def say(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        what, now = str(context["message"]), time.monotonic()
        if now >= said_at.get(what, 0.0):
            said_at[what] = now + _SAID_AGAIN
            error = context.get("exception")
            logger.error("%s: %s: %r", server, what, error)
            logger.debug("%s", what, exc_info=error)

    asyncio.get_running_loop().set_exception_handler(say)


async def serve_at(
    make: Callable[[], asyncio.BaseProtocol],
    host: str | None = None,
    port: int | None = None,
    **more: Any,  # noqa: ANN401 - asyncio's
) -> asyncio.Server:
    """Return a server that accepts a few connections at a time, while many wait in the kernel.

    Args:
        make: returns the protocol of a new connection.
        host: to listen on; None with `sock`.
        port: likewise.
        more: for `create_server`, which raises `OSError` where the address is in use.
    """
    loop = asyncio.get_running_loop()
    server = await loop.create_server(make, host, port, backlog=_AT_ONCE, **more)
    lengthen_queues(server)
    return server


def lengthen_queues(server: asyncio.Server) -> None:
    """Have the kernel keep more connections for a server than it accepts in a row."""
    for listener in server.sockets:
        with listener.dup() as same:  # asyncio's own has no `listen`
            same.listen(QUEUE)


def _most_files() -> int:
    """Return the number of files that this process may open."""
    try:
        import resource  # noqa: PLC0415 - Windows has none
    except ImportError:
        return 512
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return 1 << 20 if limit == resource.RLIM_INFINITY else limit
