"""The server of a feed, and its process."""

import asyncio
import contextlib
import json
import logging
import os
import select
import socket
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from time import monotonic_ns
from typing import Any, NamedTuple

from hil_bench.abilities.common.reception import capacity, say_errors_in_a_line, serve_at
from hil_bench.abilities.common.shared_ring import SharedRing, unpack_frames
from hil_bench.abilities.live import messages
from hil_bench.abilities.live.client_link import ClientLink
from hil_bench.outside.helper_process import HelperProcess
from hil_bench.outside.realtime.statistics import DurationHistogram, TickStatistics

# The server of the feed: what it hears from the loop it passes on to clients, and the reverse.
#
# It does no I/O of its own: asyncio owns the sockets, shared memory leads to the loop. A client
# that reads too slowly loses rows, frames and events of its own picture, which are counted; it
# costs nobody else anything.


MOST_CLIENTS = 64

LOOK = 0.1
"""Time between two rows where no client wants them more often [s]."""


class FeedPlan(NamedTuple):
    """The greeting, the row width and the queues of a server.

    Attributes:
        hello: what a client is greeted with, beside type and version.
        width: values of a row, its time included.
        up: messages from the loop.
        down: messages to the loop.
        statistics: of the loop, shared; None where it has no times to keep.
    """

    hello: Mapping[str, Any]
    width: int
    up: SharedRing
    down: SharedRing
    statistics: TickStatistics | None = None

    @property
    def row(self) -> struct.Struct:
        """The layout of a row in shared memory."""
        return struct.Struct(f"<{self.width}d")


class FeedServer:
    """Serves clients.

    Args:
        plan: what to serve.

    Attributes:
        clients: those that are connected.
    """

    def __init__(self, plan: FeedPlan) -> None:
        self.clients: list[ClientLink] = []
        self._seats = sum(capacity(MOST_CLIENTS, room=0))
        self._plan = plan
        self._row = plan.row
        self._wanted = 0
        # No answer to an earlier server's ticket is taken for one of ours.
        self._ticket = os.getpid() << 32
        self._open: dict[int, tuple[ClientLink, int]] = {}
        self._state: dict[str, Any] | None = None
        self._last_row: list[str] | None = None
        self._health: dict[str, Any] = {}
        self._asked: list[tuple[ClientLink, int]] = []
        self._takers: dict[int, Callable[[bytes], None]] = {
            messages.ROW: self._take_row,
            messages.FRAMES: self._take_frames,
            messages.STATE: self._take_state,
            messages.HEALTH: self._take_health,
            messages.ANSWER: self._take_answer,
            messages.EVENT: self._take_event,
            messages.ACTED: self._take_acted,
        }
        plan.down.put(messages.WANTS, bytes([0]))

    def admit(self, client: ClientLink) -> bool:
        """Greet a client, if there is room for it; one that does not ask makes some."""
        if len(self.clients) >= self._seats:
            idler = next((each for each in self.clients if not each.has_asked), None)
            if idler is not None:
                self.leave(idler)
                idler.abort()
        if len(self.clients) >= self._seats:
            text = f"{self._seats} clients are connected already; close one"
            client.write(messages.encode({"type": "error", "error": text}))
            return False
        self.clients.append(client)
        client.write(
            messages.encode({"type": "hello", "version": messages.VERSION, **self._plan.hello})
        )
        self.review()
        return True

    def leave(self, client: ClientLink) -> None:
        """Forget a client; commands that it has given act all the same."""
        if client in self.clients:
            self.clients.remove(client)
            self._asked = [asked for asked in self._asked if asked[0] is not client]
            self._open = {n: asked for n, asked in self._open.items() if asked[0] is not client}
            self.review()

    def review(self) -> None:
        """Let the loop know what clients want, where that has changed."""
        wanted = messages.WANTS_STATE if self.clients else 0
        for client in self.clients:
            if client.rows_every is not None and client.rows_every < LOOK:
                wanted |= messages.WANTS_ROWS
            if client.wants_frames:
                wanted |= messages.WANTS_FRAMES
        if not wanted:
            self._state = self._last_row = None  # out of date when the next client comes
        if wanted != self._wanted and self._plan.down.put(messages.WANTS, bytes([wanted])):
            self._wanted = wanted

    def handle(self, client: ClientLink, request: messages.Request) -> None:
        """Do what a client asks for, or pass it on to the loop."""
        if request.action == "watch":
            client.rows_every = request.fields.get("rows_every_s")
            client.wants_frames = request.fields.get("frames", False)
            self.review()
            client.answer(request.number, {"value": None})
            if self._state is not None:
                client.show(messages.encode({"type": "state", **self._state}))
        elif request.action == "status":
            self._asked.append((client, request.number))
            self._answer_status()
        elif request.action == "histograms":
            client.answer(request.number, {"value": _histograms(self._plan.statistics)})
        else:
            self._pass_on(client, request)

    def poll(self) -> None:
        """Pass on what the loop has published."""
        for kind, message in self._plan.up.take():
            self._takers[kind](message)
        for client in self.clients:
            client.flush()
        self.review()

    def _pass_on(self, client: ClientLink, request: messages.Request) -> None:
        self._ticket += 1
        command = {"ticket": self._ticket, "do": request.action, "fields": request.fields}
        if self._plan.down.put(messages.COMMAND, messages.encode(command)):
            self._open[self._ticket] = (client, request.number)
        else:
            error = "the bench takes no command at present; too many wait, or its time stands still"
            client.answer(request.number, {"error": error, "kind": "bench"})

    def _answer_status(self) -> None:
        """Answer who has asked, once the loop has said how it is."""
        if self._state is None:
            return
        names = ["time", *(name for name, _ in self._plan.hello["channels"])]
        row = self._last_row
        values = None if row is None else dict(zip(names, map(json.loads, row), strict=True))
        status = {"state": self._state, "values": values, "health": self._health}
        asked, self._asked = self._asked, []
        for client, number in asked:
            client.answer(number, {"value": status})

    def _take_row(self, message: bytes) -> None:
        values = self._row.unpack(message)
        self._last_row = [messages.number_text(value) for value in values]
        text = f"[{','.join(self._last_row)}]".encode()
        for client in self.clients:
            client.show_row(values[0], text)

    def _take_frames(self, message: bytes) -> None:
        frames = [
            [time * 1e-9, frame.bus, "in" if is_received else "out", frame.can_id, *_rest(frame)]
            for frame, time, is_received in unpack_frames(message)
        ]
        line = messages.encode({"type": "frames", "frames": frames})
        for client in self.clients:
            if client.wants_frames:
                client.show(line, frames=len(frames))

    def _take_state(self, message: bytes) -> None:
        self._state = json.loads(message)
        self._show({"type": "state", **(self._state or {})})
        self._answer_status()

    def _take_event(self, message: bytes) -> None:
        self._show({"type": "event", **json.loads(message)})

    def _take_acted(self, message: bytes) -> None:
        self._show({"type": "command", **json.loads(message)})

    def _take_health(self, message: bytes) -> None:
        self._health = {**json.loads(message), **_loop_health(self._plan.statistics)}
        self._show({"type": "health", **self._health})

    def _take_answer(self, message: bytes) -> None:
        content = json.loads(message)
        client, number = self._open.pop(content.pop("ticket"), (None, 0))
        if client is not None:
            client.answer(number, content)

    def _show(self, message: Mapping[str, object]) -> None:
        line = messages.encode(message)
        for client in self.clients:
            if client.is_watching:
                client.show(line)


def _rest(frame: Any) -> Sequence[object]:  # noqa: ANN401 - a Frame
    return frame.data.hex(), frame.is_extended, frame.is_remote, frame.fd


def _loop_health(statistics: TickStatistics | None) -> dict[str, object]:
    if statistics is None:
        return {}
    return {
        "ticks": statistics.ticks,
        "overruns": statistics.overruns,
        "skipped": statistics.skipped,
        "lateness": _duration(statistics.lateness),
        "work": _duration(statistics.work),
    }


def _histograms(statistics: TickStatistics | None) -> dict[str, object] | None:
    """Return upper edge [us] and count of each bin that is not empty."""
    if statistics is None:
        return None
    return {"lateness": [*statistics.lateness.bins()], "work": [*statistics.work.bins()]}


def _duration(duration: DurationHistogram) -> dict[str, float]:
    return {
        "p50_us": duration.percentile(50),
        "p99_us": duration.percentile(99),
        "p999_us": duration.percentile(99.9),
        "max_us": duration.maximum / 1e3,
    }


# The process that serves the clients of a running bench.
#
# The loop's process owns the listening socket, and starts the server when the first client knocks.
# Until then a bench that nobody watches has no further process, and a look costs it one system
# call. A server that has ended is started again with the next client; what waits in the socket is
# kept.


logger = logging.getLogger(__name__)

CAPACITY = 1 << 20
"""Bytes between loop and server: some seconds of a 1 kHz bench of one axis."""

MOST_COMMANDS = 1 << 18
"""Bytes of commands that wait for the loop."""

_AGAIN = 1_000_000_000  # shortest time between two starts [ns]
_POLL = 0.01
_IDLE_POLL = 0.2
_FAREWELL = 0.5
_STOP_TIMEOUT = 2.0
_NICENESS = 5


class FeedProcess:
    """A server that runs as soon as somebody wants it.

    Args:
        listener: the listening socket; somebody else closes it.
        plan: what the server serves.
        clock: says when it may be started again [ns].
    """

    def __init__(
        self,
        listener: socket.socket,
        plan: FeedPlan,
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._listener = listener
        self._plan = plan
        self._clock = clock
        self._start_at = clock()
        self._helper: HelperProcess | None = None
        self._start: threading.Thread | None = None
        self._problem: str | None = None
        self._poll = select.poll()
        self._poll.register(listener, select.POLLIN)
        # The loop may be tied to one processor later; its clients are not.
        self._processors = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None

    @property
    def pid(self) -> int | None:
        """Identifier of the server's process, None where there is none."""
        return None if self._helper is None else self._helper.pid

    def look(self) -> bool:
        """Start the server where somebody waits for it; return whether there is one."""
        if self._start is not None:
            if self._start.is_alive():
                return False
            self._start = None
        if self._helper is not None:
            ending = self._problem or self._helper.ending()
            if ending is None:
                return True
            logger.warning("feed: its process %s; the next client starts it again", ending)
            self._helper.stop(_STOP_TIMEOUT)
            self._helper = None
        now = self._clock()
        if now >= self._start_at and self._poll.poll(0):
            self._start_at = now + _AGAIN
            self._begin()
        return False

    def stop(self) -> None:
        """End the server."""
        if self._start is not None:
            self._start.join()
        if self._helper is not None:
            self._helper.stop(_STOP_TIMEOUT)

    def _begin(self) -> None:
        self._problem = None
        self._helper = HelperProcess(serve, (self._listener, self._plan), name="hil-bench-feed")
        self._start = threading.Thread(target=self._run, args=(self._helper,), daemon=True)
        self._start.start()

    def _run(self, helper: HelperProcess) -> None:
        if self._processors is not None:  # what is started inherits them
            with contextlib.suppress(OSError):
                os.sched_setaffinity(0, self._processors)
        try:
            helper.start()
        except OSError as error:
            self._problem = f"cannot be started ({error.strerror or error})"


def serve(listener: socket.socket, plan: FeedPlan, connection: Connection) -> None:
    """Serve clients until the loop lets go of the connection."""
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    asyncio.run(_serve(listener, plan, connection))


async def _serve(listener: socket.socket, plan: FeedPlan, connection: Connection) -> None:
    loop = asyncio.get_running_loop()
    server = FeedServer(plan)
    over = asyncio.Event()
    loop.add_reader(connection.fileno(), over.set)
    say_errors_in_a_line("feed")
    await serve_at(lambda: ClientLink(server), sock=listener)
    while not over.is_set():
        server.poll()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(over.wait(), _POLL if server.clients else _IDLE_POLL)
    loop.remove_reader(connection.fileno())
    server.poll()
    for client in list(server.clients):
        client.write(messages.encode({"type": "end"}))
        client.close()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_FAREWELL):
            while server.clients:
                await asyncio.sleep(_POLL)
