"""The process that serves the clients of a running bench.

The loop's process owns the listening socket, and starts the server when the first client knocks.
Until then a bench that nobody watches has no further process, and a look costs it one system call.
A server that has ended is started again with the next client; what waits in the socket is kept.
"""

import asyncio
import contextlib
import logging
import os
import select
import socket
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from time import monotonic_ns

from hil_bench.abilities.live.client_link import ClientLink
from hil_bench.abilities.live.messages import encode
from hil_bench.abilities.live.server import FeedPlan, FeedServer
from hil_bench.outside.processes.helper_process import HelperProcess
from hil_bench.outside.reception import say_errors_in_a_line, serve_at

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
        client.write(encode({"type": "end"}))
        client.close()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_FAREWELL):
            while server.clients:
                await asyncio.sleep(_POLL)
