"""The web application of the panel, and its connections."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from hil_bench.abilities.common.reception import (
    ROOM,
    WaitingRoom,
    capacity,
    lengthen_queues,
    watch_over,
)
from hil_bench.abilities.live.messages import encode
from hil_bench.abilities.panel.desk import Desk
from hil_bench.abilities.panel.guard import EXPORT, App, Guard, Secret
from hil_bench.abilities.panel.hub import Hub, Viewer
from hil_bench.abilities.panel.record import MOST_BYTES, make_mf4
from hil_bench.errors import BusError, ConfigError

# The connections of a panel, bounded in number and patience: uvicorn's own have no such bounds.
#
# A connection waits (see `WaitingRoom`) until a whole request has come, and again behind the
# answer. A request that is being answered is busy, for longer; a WebSocket waits until it has the
# secret.

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


# The panel as an ASGI application: one static page, and a WebSocket a browser.

STATIC = Path(__file__).parent / "static"

MOST_OPEN = 16
"""Requests of a browser that may wait for their answers; beyond, it is not read from."""

KNOCK_TIME = 5.0
"""Longest time until a browser has said its secret [s]."""

_PENANCE = 1.0  # after a wrong secret [s]
_REFUSED, _FULL = 4401, 4429  # WebSocket close codes of our own


class Panel:
    """The server's side of all pages.

    Args:
        hub: leads to the bench.
        desk: does what pages ask for.
        secret: lets them in.
    """

    def __init__(self, hub: Hub, desk: Desk, secret: Secret) -> None:
        self._hub = hub
        self._desk = desk
        self._secret = secret

    def app(self, port: int, *, is_local: bool) -> App:
        """Return the guarded application.

        Args:
            port: that it listens on.
            is_local: whether that is the loopback only.
        """
        routes = [
            WebSocketRoute("/feed", self.serve),
            Route(EXPORT, self.export, methods=["POST"]),
            Mount("/", StaticFiles(directory=STATIC, html=True)),
        ]
        return Guard(Starlette(routes=routes), port, is_local=is_local)

    async def serve(self, browser: WebSocket) -> None:
        """Serve a browser until it goes."""
        await browser.accept()
        with contextlib.suppress(WebSocketDisconnect):
            if await self._has_secret(browser):
                viewer = Viewer(browser.send_bytes)
                try:
                    self._hub.admit(viewer)
                except BusError as error:
                    await _dismiss(browser, _FULL, str(error))
                    return
                try:
                    await self._follow(browser, viewer)
                finally:
                    self._hub.leave(viewer)

    async def export(self, request: Request) -> Response:
        """Return the rows that a page sends as an MF4 file."""
        scheme, _, secret = request.headers.get("authorization", "").partition(" ")
        if scheme != "Bearer" or not self._secret.fits(secret):
            await asyncio.sleep(_PENANCE)
            return PlainTextResponse("the secret is not this panel's", 401)
        try:
            return Response(
                await run_in_threadpool(make_mf4, await _body(request)),
                media_type="application/octet-stream",
            )
        except ConfigError as error:
            return PlainTextResponse(str(error), 400)
        except ClientDisconnect:
            return Response(status_code=400)

    async def _has_secret(self, browser: WebSocket) -> bool:
        """Return True if the first message is the secret."""
        try:
            async with asyncio.timeout(KNOCK_TIME):
                text = await _hear(browser)
            if self._secret.fits(_token(text)):
                browser.scope["extensions"][SETTLE]["settle"]()
                return True
            await asyncio.sleep(_PENANCE)
            await _dismiss(browser, _REFUSED, "the secret in the address is not this panel's")
        except TimeoutError:
            await _dismiss(browser, _REFUSED, "no secret was said in time")
        return False

    async def _follow(self, browser: WebSocket, viewer: Viewer) -> None:
        """Show a browser the bench and do what it asks for, until it goes."""
        tasks = {
            asyncio.create_task(viewer.pump()),
            asyncio.create_task(self._listen(browser, viewer)),
            asyncio.create_task(viewer.over.wait()),
        }
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _listen(self, browser: WebSocket, viewer: Viewer) -> None:
        async with _tasks() as group:
            while True:
                text = await _hear(browser)
                while len(group) >= MOST_OPEN or viewer.is_slow:
                    await asyncio.sleep(0.05)
                task = asyncio.create_task(self._answer(viewer, text))
                group.add(task)
                task.add_done_callback(group.discard)

    async def _answer(self, viewer: Viewer, text: str) -> None:
        viewer.tell(await self._desk.answer(viewer, text))


@contextlib.asynccontextmanager
async def _tasks() -> AsyncIterator[set["asyncio.Task[None]"]]:
    """Yield a set of tasks that do not outlive the block.

    Yields:
        The set.
    """
    tasks: set[asyncio.Task[None]] = set()
    try:
        yield tasks
    finally:
        for task in tasks:
            task.cancel()


async def _hear(browser: WebSocket) -> str:
    """Return the next message.

    Raises:
        WebSocketDisconnect: it is gone, or sends no text.
    """
    message = await browser.receive()
    text = message.get("text")
    if message["type"] != "websocket.receive" or not isinstance(text, str):
        raise WebSocketDisconnect(1003)
    return text


async def _body(request: Request) -> bytes:
    """Return the body of a request.

    Raises:
        ConfigError: it is too long.
    """
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_BYTES:
            raise ConfigError(f"mf4: more than {MOST_BYTES >> 20} MiB; zoom in, or choose less")
    return bytes(body)


async def _dismiss(browser: WebSocket, code: int, words: str) -> None:
    await browser.send_bytes(encode({"type": "refused", "words": words}))
    await browser.close(code)


def _token(text: str) -> Any:  # noqa: ANN401 - whatever somebody sends
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return content.get("token") if isinstance(content, dict) else None
