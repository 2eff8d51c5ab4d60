"""The client of a feed."""

import asyncio
import itertools
import json
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, Self, cast

from hil_bench.abilities.live import messages
from hil_bench.abilities.live.places import HAS_SOCKETS, find_names, place_of
from hil_bench.errors import BusError, ConfigError, WaitTimeoutError, printable

# A client of a running bench: one connection, in the caller's thread.


TIMEOUT = 5.0
"""Longest wait for an answer [s]."""

_MOST_LINE = 1 << 24
_MOST_KEPT = 10_000  # messages that wait while an answer is awaited
_CHUNK = 1 << 16


class BenchEndError(BusError):
    """The bench has ended in order."""


class FeedClient:
    """A connection to a bench, as a context manager.

    Args:
        name: of the bench.
        connection: a connected socket, which the client closes.
        timeout: longest wait for an answer [s].
        clock: says how long that is [s].

    Attributes:
        name: of the bench.
        hello: what the bench says of itself.

    Raises:
        BusError: the bench does not greet, or speaks another version.
    """

    def __init__(
        self,
        name: str,
        connection: socket.socket,
        timeout: float = TIMEOUT,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = name
        self._socket = connection
        self._timeout = timeout
        self._clock = clock
        self._buffer = bytearray()
        self._kept: deque[dict[str, Any]] = deque(maxlen=_MOST_KEPT)
        self._numbers = itertools.count(1)
        try:
            self.hello = self._greeting()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the bench."""
        self._socket.close()

    def request(self, action: str, **fields: object) -> Any:  # noqa: ANN401 - what it answers
        """Ask the bench for something and return its answer.

        `ControllerError`: the bench cannot do it. `BusError`: the bench is gone.

        Raises:
            ConfigError: the request is wrong.
            WaitTimeoutError: it does not answer, since its time stands still.
        """
        number = next(self._numbers)
        try:
            line = messages.encode({"id": number, "do": action, **fields})
        except (TypeError, ValueError):
            sent = ", ".join(f"{name} = {value}" for name, value in fields.items())
            raise ConfigError(
                printable(f"{action}: {sent}: give finite numbers and texts")
            ) from None
        self._send(line)
        timeout = messages.patience(action, self._timeout)
        deadline = self._clock() + timeout
        while True:
            message = self._read(deadline - self._clock())
            if message is None:
                raise WaitTimeoutError(
                    f"bench {self.name}: no answer in {timeout:g} s; its time stands still, "
                    "or it is too busy"
                )
            if message.get("type") != "answer" or message.get("id") not in {number, None}:
                self._kept.append(message)
            else:
                return messages.value_of(message)

    def receive(self, timeout: float) -> dict[str, Any] | None:
        """Return the next message that is no answer; None where none comes in time [s].

        `BenchEndError`: the bench has ended; another `BusError`: it is gone.
        """
        return self._kept.popleft() if self._kept else self._read(timeout)

    def _greeting(self) -> dict[str, Any]:
        message = self._read(self._timeout)
        if message is None:
            raise WaitTimeoutError(f"bench {self.name}: no greeting in {self._timeout:g} s")
        messages.check_version(self.name, message)
        return message

    def _send(self, line: bytes) -> None:
        try:
            self._socket.settimeout(self._timeout)
            self._socket.sendall(line)
        except OSError as error:
            raise self._gone() from error

    def _read(self, timeout: float) -> dict[str, Any] | None:
        """Return the next message; None where none comes in time [s].

        Raises:
            BusError: the bench is gone.
        """
        deadline = self._clock() + timeout
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > _MOST_LINE:
                raise BusError(f"bench {self.name}: a message without an end")
            remaining = deadline - self._clock()
            if remaining <= 0:
                return None
            try:
                self._socket.settimeout(remaining)
                chunk = self._socket.recv(_CHUNK)
            except TimeoutError:
                return None
            except OSError as error:
                raise self._gone() from error
            if not chunk:
                raise self._gone()
            self._buffer += chunk
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return self._checked(line)

    def _checked(self, line: bytes) -> dict[str, Any]:
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            raise BusError(f"bench {self.name}: its message is not a JSON object")
        if message.get("type") == "error":
            raise BusError(f"bench {self.name}: {printable(str(message.get('error')))}")
        if message.get("type") == "end":
            raise BenchEndError(f"bench {self.name}: it has ended")
        return message

    def _gone(self) -> BusError:
        return BusError(f"bench {self.name}: the connection is lost")


def connect(name: str | None = None, timeout: float = TIMEOUT) -> FeedClient:
    """Connect to a running bench.

    Args:
        name: of the bench; not needed where only one runs.
        timeout: longest wait for an answer [s].

    Raises:
        BusError: there is no such bench, or no bench at all; `ConfigError` where several run, and
            none is named.
    """
    if not HAS_SOCKETS:
        raise BusError("this machine has no Unix sockets, by which a running bench is watched")
    if name is None:
        name = only_one(find_names())
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(timeout)
        connection.connect(str(place_of(name)))
    except (FileNotFoundError, ConnectionRefusedError) as error:
        connection.close()
        raise BusError(f'no bench with the name "{name}" runs') from error
    except OSError as error:
        connection.close()
        raise BusError(f"bench {name}: {error.strerror or error}") from error
    return FeedClient(name, connection, timeout)


def only_one(names: Sequence[str]) -> str:
    """Return the one name.

    Raises:
        BusError: there is none.
        ConfigError: there are several.
    """
    if not names:
        raise BusError("no bench runs; start one with hil-bench run")
    if len(names) > 1:
        raise ConfigError(f"{len(names)} benches run; name one of {', '.join(names)}")
    return names[0]


# A client of the feed as its server sees it: lines in, lines out, and none too many of either.


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

    def handle(self, client: "ClientLink", request: messages.Request) -> None:
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
            self.write(messages.encode({"type": "lost", **self._lost}))
            self._lost = dict.fromkeys(self._lost, 0)
        self._take_lines()

    def write(self, line: bytes) -> None:
        """Send it a line."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(line)

    def answer(self, number: int, content: Mapping[str, object]) -> None:
        """Answer a request."""
        self._open -= 1
        self.write(messages.encode({"type": "answer", "id": number, **content}))
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
            end = self._buffer.find(b"\n", 0, messages.MOST_REQUEST)
            if end < 0:
                break
            line = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._take(line)
        self._is_handling = False
        if (
            len(self._buffer) >= messages.MOST_REQUEST
            and self._buffer.find(b"\n", 0, messages.MOST_REQUEST) < 0
        ):
            self._buffer.clear()
            text = f"a request has {messages.MOST_REQUEST} bytes at most; this one is longer"
            self.write(messages.encode({"type": "error", "error": text}))
            self.close()
        self._set_reading()

    def _take(self, line: bytes) -> None:
        try:
            request = messages.parse_request(line)
        except messages.RequestError as error:
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
