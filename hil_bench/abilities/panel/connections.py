"""The connections of a panel, bounded in number and patience: uvicorn's own have no such bounds.

A connection waits (see `WaitingRoom`) until a whole request has come, and again behind the answer.
A request that is being answered is busy, for longer; a WebSocket waits until it has the secret.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from hil_bench.outside.reception import (
    ROOM,
    WaitingRoom,
    capacity,
    lengthen_queues,
    watch_over,
)

SETTLE = "hil_bench.settle"
"""The ASGI extension by which a WebSocket that has the secret takes a seat."""

AT_ONCE = 4
"""Connections accepted in a row, so that those before them are seen to first."""

_BUSY = 60.0  # longest time for a request and its answer [s]


class Connections:
    """The connections of one server.

    Args:
        seats: of browsers that have the secret.

    Attributes:
        seats: likewise, or fewer where the process may not open so many files.
        waiting: those of which nothing whole has come.
        busy: those that are being answered.
    """

    def __init__(self, seats: int) -> None:
        self.seats, room = capacity(seats, 2 * ROOM)
        self.waiting: WaitingRoom[Any] = WaitingRoom(_cut, room // 2)
        self.busy: WaitingRoom[Any] = WaitingRoom(_cut, room // 2, _BUSY)

    def leave(self, guest: object) -> None:
        """Forget a connection that is gone, or has a seat."""
        self.waiting.leave(guest)
        self.busy.leave(guest)

    def http(self) -> type[asyncio.Protocol]:
        """Return the protocol of HTTP for uvicorn."""
        return type("Http", (_Http,), {"all": self})

    def websocket(self) -> type[asyncio.Protocol]:
        """Return the protocol of WebSockets for uvicorn."""
        return type("Socket", (_Socket,), {"all": self})


class Server(uvicorn.Server):
    """A server with bounded connections.

    Args:
        config: with `AT_ONCE` as its backlog, and the protocols of the connections.
        connections: those of the configuration.
        stopped: asked ten times a second.
    """

    def __init__(
        self, config: uvicorn.Config, connections: Connections, stopped: Callable[[], bool]
    ) -> None:
        super().__init__(config)
        self._connections, self._stopped = connections, stopped

    async def on_tick(self, counter: int) -> bool:
        """Return True to end."""
        return await super().on_tick(counter) or self._stopped()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen."""
        await super().startup(sockets)
        for server in self.servers:
            lengthen_queues(server)

    async def main_loop(self) -> None:
        """Serve until the end, and look after those that wait."""
        care = asyncio.create_task(watch_over(self._connections.waiting, self._connections.busy))
        try:
            await super().main_loop()
        finally:
            care.cancel()


class _Http(H11Protocol):
    """A connection that speaks HTTP, or begins to."""

    all: Connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.all.waiting.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.all.leave(self)
        super().connection_lost(exc)

    def handle_events(self) -> None:
        before = self.cycle
        super().handle_events()
        if self.cycle is not before and not self.cycle.response_complete:
            self.all.waiting.leave(self)
            self.all.busy.enter(self)

    def handle_websocket_upgrade(self, event: Any) -> None:  # noqa: ANN401 - h11's request
        self.all.leave(self)
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        self.all.busy.leave(self)
        self.all.waiting.enter(self)
        super().on_response_complete()


class _Socket(WebSocketsSansIOProtocol):
    """A WebSocket."""

    all: Connections

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.all.waiting.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.all.leave(self)
        super().connection_lost(exc)

    def handle_connect(self, event: Any) -> None:  # noqa: ANN401 - a request of websockets
        super().handle_connect(event)
        if hasattr(self, "scope"):
            self.scope["extensions"][SETTLE] = {"settle": lambda: self.all.leave(self)}

    def send_receive_event_to_app(self) -> None:
        if self.close_sent:
            self.frames = []
        elif self.curr_msg_data_type == "text" and not _is_text(b"".join(self.frames)):
            self.frames = []
            self.conn.send_close(1007)  # what uvicorn does, but for a traceback a frame
            self.handle_parser_exception()
        else:
            super().send_receive_event_to_app()


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True


def _cut(protocol: H11Protocol | WebSocketsSansIOProtocol) -> None:
    protocol.transport.abort()
