"""A program under test in a process of its own, its output in files."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from operator import methodcaller
from pathlib import Path
from typing import NamedTuple

from hil_bench.errors import ControllerError, HilBenchError

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)

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
    is_path = len(Path(program).parts) > 1
    right = f"a relative path counts from {Path.cwd()}" if is_path else "it is not on the PATH"
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

    Attributes:
        process: the process.

    Raises:
        ControllerError: it cannot be started.
    """

    def __init__(
        self, command: Sequence[str], directory: Path, variables: Mapping[str, str]
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
                )
            except OSError as error:
                raise ControllerError(_why_unstarted(command[0], error)) from None

    @property
    def is_running(self) -> bool:
        """Return True if it runs."""
        return self.process.poll() is None

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
