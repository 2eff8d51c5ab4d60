"""A browser that looks at a panel: what waits for it, and what it has lost."""

import asyncio
from collections.abc import Awaitable, Callable

from hil_bench.outside.feed.messages import encode

MOST_UNREAD = 1 << 20
"""Bytes that may wait for a browser; beyond, it loses rows, frames and events."""

MOST_WAITING = 1 << 22
"""Bytes of all that may wait for a browser; beyond, it is given up."""

Send = Callable[[bytes], Awaitable[None]]
"""Sends a message to the browser; it returns when there is room for the next one."""


class Viewer:
    """One browser.

    Args:
        send: to it.

    Attributes:
        wants_frames: whether it shows frames.
        wants_marks: whether it marks the frames that are news.
        lost: messages that it has lost since the last time it was told.
        over: set when it is given up.
    """

    def __init__(self, send: Send) -> None:
        self.wants_frames = False
        self.wants_marks = False
        self.lost = 0
        self.over = asyncio.Event()
        self._send = send
        self._waiting: list[bytes] = []
        self._size = 0
        self._wake = asyncio.Event()

    def offer(self, lines: bytes) -> None:
        """Send it lines that it may lose."""
        if self.is_slow:
            self.lost += lines.count(b"\n")
        else:
            self.tell(lines)

    def tell(self, lines: bytes) -> None:
        """Send it lines that it must have."""
        self._waiting.append(lines)
        self._size += len(lines)
        self._wake.set()
        if self._size > MOST_WAITING:
            self.over.set()

    @property
    def is_slow(self) -> bool:
        """Return True if it has to read before it gets more."""
        return self._size > MOST_UNREAD

    async def pump(self) -> None:
        """Send what waits, for ever."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            if self.lost:
                self._waiting.insert(0, encode({"type": "missed", "messages": self.lost}))
                self.lost = 0
            lines, self._waiting = b"".join(self._waiting), []
            await self._send(lines)
            self._size = sum(map(len, self._waiting))
