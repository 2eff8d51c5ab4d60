"""The panel as an ASGI application: one static page, and a WebSocket a browser."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from hil_bench.abilities.panel.connections import SETTLE
from hil_bench.abilities.panel.desk import Desk
from hil_bench.abilities.panel.export import MOST_BYTES, make_mf4
from hil_bench.abilities.panel.guard import EXPORT, App, Guard, Secret
from hil_bench.abilities.panel.hub import Hub
from hil_bench.abilities.panel.viewer import Viewer
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.feed.messages import encode

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

    def app(self, port: int, *, is_local: bool = True) -> App:
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
