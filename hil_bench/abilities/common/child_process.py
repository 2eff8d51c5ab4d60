"""A server in a process of its own, so that its Python does not hold up the loop's.

The child's function gets a connection as its last argument. What it sends there first says how the
start went: an answer for the parent, or a text that says why it failed.
"""

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from typing import Any

from hil_bench.errors import BusError
from hil_bench.outside.helper_process import HelperProcess

logger = logging.getLogger(__name__)
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
        self._label = label
        self._helper = HelperProcess(_run_server, (target, *arguments), name=name)

    @property
    def alive(self) -> bool:
        """Return True if the process runs."""
        return self._helper.alive

    @property
    def pid(self) -> int | None:
        """Its process-ID, None before `start`."""
        return self._helper.pid

    def start(self) -> Any:  # noqa: ANN401 - what the child has to say
        """Start it and return its answer.

        Raises:
            BusError: it says why it cannot serve, or it did not start.
        """
        self._helper.start()
        answer = self._first_answer()
        if isinstance(answer, str):
            self.stop()
            raise BusError(answer)
        return answer

    def ending(self) -> str | None:
        """Describe how the process ended, as in "was killed (SIGKILL)"; None while it runs."""
        ending = self._helper.ending()
        if self._helper.trace:
            logger.debug("%s: %s", self._label, self._helper.trace)
        return ending

    def stop(self) -> None:
        """End it."""
        self._helper.stop(_STOP_TIMEOUT)

    def _first_answer(self) -> Any:  # noqa: ANN401
        try:
            return self._helper.receive(_START_TIMEOUT)
        except EOFError as end:
            reason = f": {end}" if str(end) else ""
            return f"{self._label}: the process ended at once{reason}"
        except TimeoutError:
            return f"{self._label}: the process did not start in {_START_TIMEOUT:g} s"


def _run_server(target: Callable[..., None], *arguments: Any) -> None:  # noqa: ANN401
    threading.Thread(target=_end_with_parent, args=(arguments[-1],), daemon=True).start()
    target(*arguments)


def _end_with_parent(connection: Connection) -> None:
    """End this process once its parent is gone, or has let go of it.

    Its daemons die only if it ends in order.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel, connection])
        os._exit(0)
