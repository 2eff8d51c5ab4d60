"""The door of a running bench: commands queue here and act at the start of the next tick.

The order of the queue is the order in which they act, and each gets an answer or an error. So a
run with the same commands before the same ticks is the same run.
"""

import threading
from collections import deque
from concurrent.futures import Future
from typing import Any

from hil_bench.errors import ControllerError
from hil_bench.session.commands import Command, Controls

MOST_WAITING = 1000
"""Most commands that wait for one tick."""


class Door:
    """Takes commands from any thread; one thread, that of the bench, lets them act.

    Args:
        controls: what the commands act on.

    Attributes:
        waiting: commands and where their answers go, the oldest first.
    """

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self.waiting: deque[tuple[Command, Future[Any]]] = deque()
        self._lock = threading.Lock()
        self._is_open = True

    def put(self, command: Command) -> "Future[Any]":
        """Queue a command.

        Returns:
            What gets its answer, or the error that ended it, in the next tick. Until then it can be
            cancelled. Who waits for it in the thread of the bench waits for ever.

        Raises:
            ControllerError: the bench has ended, or too many commands wait.
        """
        with self._lock:
            if not self._is_open:
                raise ControllerError("the bench has ended; it takes no more commands")
            if len(self.waiting) >= MOST_WAITING:
                raise ControllerError(
                    f"{MOST_WAITING} commands wait for the next tick already; wait for an answer"
                )
            answer: Future[Any] = Future()
            self.waiting.append((command, answer))
        return answer

    def admit(self, now: int) -> None:
        """Let the commands that wait act, the oldest first.

        Args:
            now: bench time of the tick that begins [ns].
        """
        for _ in range(len(self.waiting)):
            command, answer = self.waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                result = command.act(self._controls, now)
            except Exception as error:  # whatever it is, the bench goes on
                answer.set_exception(error)
            else:
                answer.set_result(result)

    def close(self) -> None:
        """Take no more commands; those that wait get an error."""
        with self._lock:
            self._is_open = False
        while self.waiting:
            _, answer = self.waiting.popleft()
            if answer.set_running_or_notify_cancel():
                answer.set_exception(ControllerError("the bench ended before its next tick"))
