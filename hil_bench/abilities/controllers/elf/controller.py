"""A simulated chip, as the bench asks it."""

import logging
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from hil_bench.abilities.controllers.busy_wait import BusyWait
from hil_bench.abilities.controllers.elf.exchange import (
    Answer,
    Order,
    State,
    pack_request,
    receive_message,
    send_message,
    unpack_answer,
)
from hil_bench.abilities.controllers.elf.job import Job, write_job
from hil_bench.abilities.controllers.process.program import SHOWN_LINES
from hil_bench.abilities.controllers.seam import TimedFrame
from hil_bench.errors import ControllerError

logger = logging.getLogger(__name__)

_GRACE = 2.0  # that a process has to end [s]


class ElfController:
    """A chip that runs a program.

    Args:
        job: the chip and its program.
        tick_ns: time from one `advance` to the next [ns].

    Raises:
        ControllerError: the program does not fit the chip, or the simulator does not start.
    """

    has_begun = True  # nobody knows what it does

    def __init__(self, job: Job, tick_ns: int) -> None:
        self._tick_ns = tick_ns
        self._name = job.path.name
        self._lines: deque[str] = deque(maxlen=SHOWN_LINES)
        self._now: int | None = None
        self._wake = 0
        self._link, theirs = socket.socketpair()
        self._busy = BusyWait(self._link.fileno())
        words = [sys.executable, "-P", "-m", __package__, str(theirs.fileno())]
        with theirs:
            self._process: subprocess.Popen[Any] | None = subprocess.Popen(  # noqa: S603 - ourselves
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # a terminal's signals are the bench's
            )
        try:
            self._exchange(write_job(job).encode())
        except BaseException:
            self.close()
            raise

    def advance(self, until: int, received: Sequence[TimedFrame]) -> Sequence[TimedFrame]:
        """Let the chip live until a moment; see `Controller`.

        A `ControllerError` says that the program has failed.
        """
        if self._now is None:  # power comes with the tick
            self._ask(Order.POWER_CYCLE, until - self._tick_ns, ())
        self._now = until
        if not received and until < self._wake:
            return ()
        answer = self._ask(Order.ADVANCE, until, received)
        self._wake = answer.wake
        return answer.sent

    def reset(self) -> None:
        """Switch power off and on again."""
        self._now, self._wake = None, 0

    @property
    def pid(self) -> int:
        """The simulator's process."""
        return self._process.pid if self._process is not None else 0

    def branch(self) -> Callable[[bool], None]:
        """Have the simulator copy itself; see `BranchingController`."""
        ours, theirs = socket.socketpair()
        with theirs:
            self._ask(Order.BRANCH, 0, ())
            socket.send_fds(self._link, [b"."], [theirs.fileno()])

        def settle(is_copy: bool) -> None:
            if not is_copy:
                ours.close()
                return
            self._link.close()
            self._link, self._process = ours, None  # that is the child of another
            self._busy = BusyWait(ours.fileno())

        return settle

    def tail(self) -> str:
        """The end of what it has printed."""
        return "\n".join(self._lines)

    def close(self) -> None:
        """End the process."""
        self._link.close()
        if self._process is None or self._process.returncode is not None:
            return
        try:
            self._process.communicate(timeout=_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()

    def _ask(self, order: Order, time: int, frames: Sequence[TimedFrame]) -> Answer:
        return self._exchange(pack_request(order, time, frames))

    def _exchange(self, request: bytes) -> Answer:
        """Return the answer to a request.

        Raises:
            ControllerError: the program has failed, or the simulator.
        """
        try:
            send_message(self._link, request)
            self._busy.wait()
            message = receive_message(self._link)
        except OSError:
            message = b""
        if not message:
            raise ControllerError(f"the simulator of {self._name} has ended: {self._epitaph()}")
        answer = unpack_answer(message)
        if answer.state is State.RUNNING and not answer.text:
            return answer
        lines = answer.text.splitlines()
        reason = lines.pop() if answer.state is State.FAILED else ""
        self._lines.extend(lines)
        for line in lines:
            logger.info("%.3f s: %s: %s", (self._now or 0) * 1e-9, self._name, line)
        if reason:
            raise ControllerError("\n".join((reason, *self._lines)))
        return answer

    def _epitaph(self) -> str:
        """The end of the process, in words."""
        if self._process is None:
            return "it was a copy, and nobody has seen how"
        _, said = self._process.communicate()
        code = self._process.returncode
        if code < 0:
            return f"killed by signal {-code}"
        lines = said.decode(errors="replace").splitlines()
        return lines[-1] if lines else f"exit code {code}"
