"""A program under test in a process of its own, and patience with one that sends no SYNC."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from operator import methodcaller
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.processes import living
from hil_bench.errors import ControllerError, ControllerFileError, HilBenchError
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.transports.transport import PATIENCE

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)

_KILL_PATIENCE = 10.0  # [s]
SHOWN_LINES = 20
"""Lines of the program's output that messages and reports show."""


def environment(address: str) -> dict[str, str]:
    """Return the environment variables that give a program its bus without an argument."""
    host, _, port = address.rpartition(":")
    if not host:
        return {"HIL_BENCH_BUS": address, "CAN_INTERFACE": "socketcan", "CAN_CHANNEL": address}
    return {
        "HIL_BENCH_BUS": address,
        "CAN_INTERFACE": "socketcand",
        "CAN_CHANNEL": "can0",
        "CAN_CONFIG": f'{{"host": "{host}", "port": {port}}}',
    }


def _why_unstarted(program: str, error: OSError) -> str:
    wrong = f"{program}: cannot be started: {error.strerror or error}"
    if Path(program).is_absolute() or not isinstance(error, FileNotFoundError):
        return wrong
    right = "it is not on the PATH"
    if Path(program).exists():
        right = "the interpreter of its first line is not there"
    elif os.sep in program:
        right = f"a relative path counts from {Path.cwd()}"
    return f"{wrong}; {right}"


class _Output(NamedTuple):
    stdout: Path
    stderr: Path


class Program:
    """A running program.

    Args:
        command: its words.
        directory: for its output.
        variables: of its environment, beside those of this process.
        descriptors: of open files that it gets.
        leads: whether it is in a process group of its own, with its children.

    Attributes:
        process: the process.

    Raises:
        ControllerFileError: it cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        directory: Path,
        variables: Mapping[str, str],
        *,
        descriptors: Sequence[int] = (),
        leads: bool = False,
    ) -> None:
        self._command = command
        self._output = _Output(directory / "stdout", directory / "stderr")
        with self._output.stdout.open("wb") as stdout, self._output.stderr.open("wb") as stderr:
            try:
                self.process = subprocess.Popen(  # noqa: S603 - the test's own program
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=stdout,
                    stderr=stderr,
                    env=os.environ | variables,
                    pass_fds=descriptors,
                    process_group=0 if leads else None,
                )
            except OSError as error:
                raise ControllerFileError(_why_unstarted(command[0], error)) from None

    @property
    def is_running(self) -> bool:
        """Return True if it runs."""
        return self.process.poll() is None

    def kill(self) -> None:
        """Kill one that leads, and its children, and wait until none of them runs, 10 s at most.

        A kill is a wish: on a busy machine a child that computes goes on until its processor
        sees it.
        """
        group = self.process.pid
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
        self.process.wait()
        deadline = time.monotonic() + _KILL_PATIENCE
        with contextlib.suppress(ProcessLookupError):
            while time.monotonic() < deadline:
                os.killpg(group, 0)  # some are left, if only dead ones that nobody has waited for
                if all(each.group != group for each in living()):
                    break
                time.sleep(0.001)

    @property
    def stdout(self) -> str:
        """The program's standard output so far."""
        return self._output.stdout.read_text(encoding="utf-8", errors="replace")

    @property
    def stderr(self) -> str:
        """The program's standard error so far."""
        return self._output.stderr.read_text(encoding="utf-8", errors="replace")

    def epitaph(self) -> str:
        """Return the state of the program, with its exit code, and the end of its output."""
        code = self.process.poll()
        state = "runs" if code is None else f"has ended, exit code {code}"
        return f"{' '.join(self._command)}: {state}\n{self.tail()}".rstrip()

    def tail(self) -> str:
        """Return the last lines of its output, standard error last."""
        lines = [*self.stdout.splitlines(), *self.stderr.splitlines()]
        return "\n".join(lines[-SHOWN_LINES:])


# Patience with a program whose SYNC lets bench time pass.


class Patience(NamedTuple):
    """The longest time that a controller may send no SYNC where that lets time pass.

    Attributes:
        longest: time after which it is given up [s].
        right: what else would be right, for the message.
    """

    longest: float = 20.0
    right: str = ""


USUAL_PATIENCE = Patience()


class Silence:
    """The time without SYNC, which has an end.

    Args:
        patience: with the controller.
        clock: the machine's clock; None is the monotonic one.
    """

    def __init__(self, patience: Patience = USUAL_PATIENCE, clock: Clock | None = None) -> None:
        self._patience = patience
        self._clock = clock or MonotonicClock()
        self._began = 0
        self._has_come = False
        self._without_sync = 0.0

    def begin(self) -> None:
        """Begin to wait for a frame, at most `transport.PATIENCE`."""
        self._began = self._clock.now()

    def end(self, *, has_come: bool, has_synced: bool) -> None:
        """End the wait.

        Args:
            has_come: whether a frame came.
            has_synced: whether it was SYNC.

        Raises:
            ControllerError: no SYNC has come for as long as the patience lasts.
        """
        if has_synced:
            self._has_come, self._without_sync = False, 0.0
            return
        # At most what was waited for: a machine that was suspended is not the controller's fault.
        self._without_sync += min((self._clock.now() - self._began) * 1e-9, PATIENCE)
        self._has_come |= has_come
        if self._without_sync > self._patience.longest:
            raise ControllerError(self._standstill())

    def _standstill(self) -> str:
        what = "frames, but no SYNC (0x080)" if self._has_come else "nobody has sent a frame"
        right = "let the controller on this bus send SYNC (as producer: bit 30 of 0x1005, 0x1006)"
        return (
            f"{what} for {self._patience.longest:g} s, and without SYNC bench time stands still; "
            f"{right}{self._patience.right}"
        )
