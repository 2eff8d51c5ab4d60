"""A server in a process of its own, so that its Python does not hold up the loop's.

The child's function gets a connection as its last argument. What it sends there first says how the
start went: an answer for the parent, or a text that says why it failed.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from typing import Any

from hil_bench.errors import BusError
from hil_bench.spawning import start_shielded

_START_TIMEOUT = 30.0
_STOP_TIMEOUT = 5.0


class ChildProcess:
    """A process that ends with its parent, however that ends; Ctrl-C is left to the parent.

    Args:
        target: what it runs; a function of a module, and a connection is its last argument.
        arguments: those before it.
        name: of the process.
        label: how messages name what it serves.
    """

    def __init__(
        self, target: Callable[..., None], arguments: tuple[object, ...], *, name: str, label: str
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._label = label
        self._connection, self._child_connection = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_run,
            args=(target, *arguments, self._child_connection),
            name=name,
            daemon=True,
        )

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    @property
    def pid(self) -> int | None:
        """Its process-ID, None before `start`."""
        return self._process.pid

    def start(self) -> Any:  # noqa: ANN401 - what the child has to say
        """Start it and return its answer.

        Raises:
            BusError: it says why it cannot serve, or it did not start.
        """
        start_shielded(self._process)
        self._child_connection.close()
        answer = self._first_answer()
        if isinstance(answer, str):
            self.stop()
            raise BusError(answer)
        return answer

    def stop(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.join(_STOP_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._connection.close()

    def _first_answer(self) -> Any:  # noqa: ANN401
        try:
            if self._connection.poll(_START_TIMEOUT):
                return self._connection.recv()
        except EOFError:
            return f"{self._label}: the process ended at once"
        return f"{self._label}: the process did not start in {_START_TIMEOUT:g} s"


def _run(target: Callable[..., None], *arguments: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    target(*arguments)


def _end_with_parent() -> None:
    """Wait for the parent's end and end this process; its daemons die only if it ends in order."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)
