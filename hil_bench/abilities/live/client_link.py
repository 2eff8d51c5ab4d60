"""A client of the feed as its server sees it: lines in, lines out, and none too many of either."""

import asyncio
from collections.abc import Mapping
from typing import Protocol, cast

from hil_bench.abilities.live.messages import (
    MOST_REQUEST,
    Request,
    RequestError,
    encode,
    parse_request,
)

MOST_UNREAD = 1 << 20
"""Bytes that may wait for a client; beyond, it loses rows, frames and events."""

MOST_OPEN = 16
"""Requests of a client that may wait for their answers; beyond, it is not read from."""

ROWS_AT_ONCE = 100
"""Most rows of a message."""

_EARLY = 0.5e-9  # of a row [s]: times are whole nanoseconds


class Server(Protocol):
    """The server of a client."""

    def admit(self, client: "ClientLink") -> bool:
        """Take a client, if there is room for it."""

    def leave(self, client: "ClientLink") -> None:
        """Forget a client."""

    def handle(self, client: "ClientLink", request: Request) -> None:
        """Do what a client asks for."""


class ClientLink(asyncio.Protocol):
    """One client.

    Args:
        server: serves it.

    Attributes:
        rows_every: least time between two rows that it wants [s]; None for no rows.
        wants_frames: whether it wants frames.
        is_watching: whether it wants states and events.
        has_asked: whether its last request was one.
    """

    def __init__(self, server: Server) -> None:
        self.rows_every: float | None = None
        self.wants_frames = False
        self.is_watching = False
        self.has_asked = False
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._buffer = bytearray()
        self._open = 0
        self._rows: list[bytes] = []
        self._next_row = 0.0
        self._last_row = 0.0
        self._is_slow = self._is_handling = False
        self._lost = {"rows": 0, "frames": 0, "others": 0}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet it, or close where there is no room."""
        self._transport = cast("asyncio.Transport", transport)
        self._transport.set_write_buffer_limits(high=MOST_UNREAD)
        if not self._server.admit(self):
            self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        """Forget it."""
        self._transport = None
        self._server.leave(self)

    def data_received(self, data: bytes) -> None:
        """Take requests."""
        self._buffer += data
        self._take_lines()

    def pause_writing(self) -> None:
        """Show it nothing more, and hear it no more, until it has read."""
        self._is_slow = True
        self._set_reading()

    def resume_writing(self) -> None:
        """Say what it has lost, and go on."""
        self._is_slow = False
        if any(self._lost.values()):
            self.write(encode({"type": "lost", **self._lost}))
            self._lost = dict.fromkeys(self._lost, 0)
        self._take_lines()

    def write(self, line: bytes) -> None:
        """Send it a line."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(line)

    def answer(self, number: int, content: Mapping[str, object]) -> None:
        """Answer a request."""
        self._open -= 1
        self.write(encode({"type": "answer", "id": number, **content}))
        if not self._is_handling:
            self._take_lines()

    def show(self, line: bytes, *, frames: int = 0) -> None:
        """Send it a line that it may lose.

        Args:
            line: the line.
            frames: how many frames it holds; 0 for something else.
        """
        if self._is_slow:
            self._lost["frames" if frames else "others"] += frames or 1
        else:
            self.flush()
            self.write(line)

    def show_row(self, time: float, row: bytes) -> None:
        """Collect a row, where it is due; see `flush`.

        Args:
            time: of the row [s].
            row: as JSON.
        """
        if self.rows_every is None:
            return
        if time < self._last_row:  # a new bench time
            self._next_row = time
        self._last_row = time
        if time < self._next_row - _EARLY:
            return
        self._next_row = max(self._next_row + self.rows_every, time + self.rows_every / 2)
        self._rows.append(row)
        if len(self._rows) >= ROWS_AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Send it the rows that have been collected."""
        rows, self._rows = self._rows, []
        if rows and self._is_slow:
            self._lost["rows"] += len(rows)
        elif rows:
            self.write(b'{"type":"rows","rows":[' + b",".join(rows) + b"]}\n")

    def abort(self) -> None:
        """Close at once, whatever is unsent."""
        if self._transport is not None:
            self._transport.abort()

    def close(self) -> None:
        """Send it what waits, and close."""
        if self._transport is not None:
            self._transport.close()

    def _take_lines(self) -> None:
        """Take the requests that are there, as many as may be open."""
        self._is_handling = True
        while self._open < MOST_OPEN and not self._is_slow and self._transport is not None:
            end = self._buffer.find(b"\n", 0, MOST_REQUEST)
            if end < 0:
                break
            line = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._take(line)
        self._is_handling = False
        if len(self._buffer) >= MOST_REQUEST and self._buffer.find(b"\n", 0, MOST_REQUEST) < 0:
            self._buffer.clear()
            text = f"a request has {MOST_REQUEST} bytes at most; this one is longer"
            self.write(encode({"type": "error", "error": text}))
            self.close()
        self._set_reading()

    def _take(self, line: bytes) -> None:
        try:
            request = parse_request(line)
        except RequestError as error:
            self.has_asked = False
            self._open += 1
            self.answer(-1, {"id": error.number, "error": str(error), "kind": "usage"})
            return
        self._open += 1
        self.has_asked = True
        if request.action == "watch":
            self.is_watching = True
            self._next_row = self._last_row
        self._server.handle(self, request)

    def _set_reading(self) -> None:
        """Read from it only where there is room for what it sends."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._is_slow or self._open >= MOST_OPEN:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()
