"""The hub in a process of its own, so that its Python does not hold up the loop's."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Self

from hil_bench.errors import BusError
from hil_bench.transports.socketcand_hub import DEFAULT_PORT, run_hub

_START_TIMEOUT = 30.0
_STOP_TIMEOUT = 5.0


class HubProcess:
    """A running hub, as a context manager.

    Its use::

        with HubProcess(port=0) as hub:
            can.Bus(interface="socketcand", channel="can0", host=hub.host, port=hub.port)

    It ends with the `with` block, and when its parent process dies; Ctrl-C is left to the parent.

    Args:
        host: address to listen on; "127.0.0.1" keeps the bus on this machine.
        port: 0 takes a free one.
        channels: names that clients may open, one bus each.

    Attributes:
        host: address it listens on.
        port: port it listens on; the actual one within the `with` block.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        channels: Sequence[str] = ("can0",),
    ) -> None:
        self.host = host
        self.port = port
        context = multiprocessing.get_context("spawn")
        self._connection, child_connection = context.Pipe(duplex=False)
        self._child_connection = child_connection
        self._process = context.Process(
            target=_run,
            args=(host, port, tuple(channels), child_connection),
            name="hil-bench-hub",
            daemon=True,
        )

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def __enter__(self) -> Self:
        """Start the process and wait until clients may connect.

        Raises:
            BusError: the address cannot be had.
        """
        self._process.start()
        self._child_connection.close()
        answer = self._first_answer()
        if not isinstance(answer, int):
            self._stop()
            raise BusError(answer)
        self.port = answer
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop()

    def _first_answer(self) -> int | str:
        """Return the port that the process listens on, or why it does not."""
        try:
            if self._connection.poll(_START_TIMEOUT):
                answer: int | str = self._connection.recv()
                return answer
        except EOFError:
            return f"hub {self.host}:{self.port}: the process ended at once"
        return f"hub {self.host}:{self.port}: the process did not start in {_START_TIMEOUT:g} s"

    def _stop(self) -> None:
        self._process.terminate()
        self._process.join(_STOP_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._connection.close()


def _run(host: str, port: int, channels: Sequence[str], connection: Connection) -> None:
    """Run a hub in this process, which is the child, and report its port or why there is none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        run_hub(host, port, connection.send, channels)
    except (BusError, ValueError) as error:
        connection.send(str(error))


def _end_with_parent() -> None:
    """Wait for the parent's end and end this process; its daemons die only if it ends in order."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)
