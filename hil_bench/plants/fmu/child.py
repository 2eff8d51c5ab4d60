"""An instance of an FMU in a process of its own, which may crash or hang alone.

Requests and answers go through pipes: the setup as a line of JSON, then in each request the number
of steps and the inputs, in each answer the outputs or what has failed.
"""

import contextlib
import json
import os
import select
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from typing import IO, Final, cast

from hil_bench.errors import printable
from hil_bench.plants.fmu.slave import Instance, Setup, SlaveError

_LONGEST_START_S: Final = 60.0
_LONGEST_STEP_S: Final = 10.0
_LONGEST_END_S: Final = 2.0
_LONGEST_REASON: Final = 2000

_HEAD: Final = struct.Struct("=?H")
"""Begin of an answer: whether it has failed, and the bytes of the reason."""


class Child:
    """As `Instance`, in another process.

    Args:
        setup: what the instance is made of.

    Raises:
        SlaveError: it cannot be started.
    """

    def __init__(self, setup: Setup) -> None:
        self._request = struct.Struct(f"=I{len(setup.written)}d")
        self._answer = struct.Struct(f"={len(setup.read)}d")
        words = [sys.executable, "-m", __name__]
        pipe = subprocess.PIPE
        with _without_ctrl_c():
            self._process = subprocess.Popen(words, stdin=pipe, stdout=pipe, bufsize=0)  # noqa: S603
        self._requests = cast("IO[bytes]", self._process.stdin)
        self._answers = cast("IO[bytes]", self._process.stdout)
        self._say(json.dumps(setup).encode() + b"\n")
        try:
            self.values = self._hear(_LONGEST_START_S)
        except SlaveError:
            self.end()
            raise

    def go_on(self, given: list[float], steps: int) -> tuple[float, ...]:
        """As `Instance.go_on`; a process that has crashed, or is silent, is a `SlaveError`, too."""
        self._say(self._request.pack(steps, *given))
        self.values = self._hear(_LONGEST_STEP_S)
        return self.values

    def end(self) -> None:
        """End the process."""
        self._requests.close()
        self._answers.close()
        try:
            self._process.wait(_LONGEST_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _say(self, request: bytes) -> None:
        with contextlib.suppress(BrokenPipeError):  # the answer says why it is gone
            self._requests.write(request)

    def _hear(self, longest_s: float) -> tuple[float, ...]:
        failed, size = _HEAD.unpack(self._take(_HEAD.size, longest_s))
        if failed:
            raise SlaveError(printable(self._take(size, longest_s).decode("utf-8", "replace")))
        return self._answer.unpack(self._take(self._answer.size, longest_s))

    def _take(self, size: int, longest_s: float) -> bytes:
        """Return some bytes of an answer.

        Raises:
            SlaveError: the process is silent, or gone.
        """
        taken = b""
        while len(taken) < size:
            # Windows cannot wait for a pipe: there, a step that hangs keeps the bench waiting.
            if os.name == "posix" and not select.select([self._answers], [], [], longest_s)[0]:
                self._process.kill()
                raise SlaveError(f"has not answered for {longest_s:g} s")
            more = self._answers.read(size - len(taken))
            if not more:
                raise SlaveError(_cause(self._process.wait()))
            taken += more
        return taken


def _cause(code: int) -> str:
    """Return why a process has ended that nobody asked to."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"has crashed: {signal.Signals(-code).name}"
    return f"has ended its process with code {code}"


@contextlib.contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Let what the block starts never hear Ctrl-C, not even while it imports.

    Yields:
        Nothing.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def main() -> None:
    """Serve the process at the other end of the standard streams; without it, end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the bench, which ends this one
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what an FMU prints is no answer
    setup = requests.readline()
    if setup.endswith(b"\n"):
        with contextlib.suppress(BrokenPipeError):  # the bench is gone
            serve(Setup(*json.loads(setup)), requests, answers)


def serve(setup: Setup, requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer requests until there are no more, or one has failed.

    Args:
        setup: what the instance is made of.
        requests: where they come from.
        answers: where the answers go; what has failed is the last.

    Raises:
        BrokenPipeError: nobody reads them any more.
    """
    request = struct.Struct(f"=I{len(setup.written)}d")
    answer = struct.Struct(f"={len(setup.read)}d")
    good = _HEAD.pack(False, 0)
    instance = None
    try:
        instance = Instance(setup)
        answers.write(good + answer.pack(*instance.values))
        while len(asked := requests.read(request.size)) == request.size:
            steps, *given = request.unpack(asked)
            answers.write(good + answer.pack(*instance.go_on(given, steps)))
    except BrokenPipeError:
        raise
    except Exception as error:  # the bench says it, in a line
        kind = "" if isinstance(error, SlaveError) else f"{type(error).__name__}: "
        reason = f"{kind}{error}".encode()[:_LONGEST_REASON]
        answers.write(_HEAD.pack(True, len(reason)) + reason)
    finally:
        if instance is not None:
            instance.end()


if __name__ == "__main__":
    main()
