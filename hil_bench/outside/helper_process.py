"""Processes beside this one: they share its terminal, leave signals to it and end with it."""

import ctypes
import multiprocessing
import signal
import struct
import sys
import threading
import traceback
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from multiprocessing.util import Finalize
from typing import Any, NamedTuple

from hil_bench.outside.signals import ENDING

_NOTHING = object()
_WANT_OF_MEMORY = ", by somebody or for want of memory"


class Failure(NamedTuple):
    """The report of a helper that an exception has ended.

    Attributes:
        text: the exception in a line.
        trace: where it came from.
    """

    text: str
    trace: str


class HelperProcess:
    """A process that works for this one.

    It gets a connection as its last argument, whose end says that this process has let go of it or
    is gone. An exception there becomes a `Failure`, not a traceback on the terminal.

    Args:
        target: what it runs; a function of a module.
        arguments: those before the connection.
        name: of the process.
    """

    def __init__(
        self, target: Callable[..., None], arguments: tuple[object, ...], *, name: str
    ) -> None:
        context = multiprocessing.get_context("spawn")
        # No lock and no event: what a killed process holds or waits for, others wait for in vain.
        self._connection, self._child_connection = context.Pipe()
        self._process = context.Process(
            target=_run,
            args=(target, *arguments, self._child_connection),
            name=name,
            daemon=True,
        )
        self._failure: Failure | None = None
        # Before multiprocessing waits for its children at the end of a program that let go of none.
        Finalize(self, self._connection.close, exitpriority=0)

    @property
    def pid(self) -> int | None:
        """Its process-ID, None before `start`."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Return True if it runs."""
        return self.pid is not None and self._process.is_alive()

    def fileno(self) -> int:
        """Return the descriptor that is readable when it says something, or has ended."""
        return self._connection.fileno()

    def start(self) -> None:
        """Start it."""
        start_shielded(self._process)
        self._child_connection.close()

    def send(self, message: object) -> None:
        """Send it something; nothing happens where it is gone."""
        try:
            self._connection.send(message)
        except OSError:
            return

    def receive(self, timeout: float) -> Any:  # noqa: ANN401 - what the helper has to say
        """Return the next thing it says.

        Args:
            timeout: longest wait for it [s].

        Raises:
            TimeoutError: it says nothing in time.
            EOFError: it has ended, or says by a `Failure` that it is about to.
        """
        try:
            message = self._connection.recv() if self._connection.poll(timeout) else _NOTHING
        except OSError as error:
            raise EOFError from error
        if message is _NOTHING:
            raise TimeoutError
        if isinstance(message, Failure):
            self._failure = message
            raise EOFError(message.text)  # noqa: TRY004 - it has ended
        return message

    def ending(self) -> str | None:
        """Describe how the process ended, as in "was killed (SIGKILL)"; None while it runs."""
        code = self._process.exitcode
        if code is None:
            return None
        try:
            while self._failure is None:
                self.receive(0)
        except (EOFError, TimeoutError):
            pass
        if self._failure is not None:
            return f"ended by an error of hil-bench ({self._failure.text})"
        if code < 0:
            why = _WANT_OF_MEMORY if -code == getattr(signal, "SIGKILL", None) else ""
            return f"was killed ({_name_of(-code)}{why})"
        return f"ended with exit code {code}"

    @property
    def trace(self) -> str:
        """Return the traceback of the exception that ended it; empty without one."""
        return "" if self._failure is None else self._failure.trace

    def stop(self, timeout: float) -> None:
        """Let go of it, and kill it where it does not end in time [s]."""
        self._connection.close()
        if self._process.pid is None:
            return
        self._process.join(timeout)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def start_shielded(process: BaseProcess) -> None:
    """Start a process that never hears Ctrl-C and the like, not even while it imports.

    A terminal sends signals to every process on it; what follows is this process's to decide. The
    other one inherits that they are blocked. Here they come once it is started: half a start would
    end in a traceback of the other one.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        process.start()
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        resource_tracker.ensure_running()  # it is shielded, too, and lets signals through here
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        with _handlers_put_off():
            process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _handlers_put_off() -> Iterator[None]:
    """Raise what came within the block after it: another thread takes what this one blocks."""
    if threading.current_thread() is not threading.main_thread():  # no handler interrupts it
        yield
        return
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _frame: came.append(number))
        for number in ENDING
        if callable(signal.getsignal(number))
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


def _name_of(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _run(target: Callable[..., None], *arguments: Any) -> None:  # noqa: ANN401
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    try:
        target(*arguments)
    except Exception as error:  # the parent is to say it, in a line
        text = " ".join(f"{type(error).__name__}: {error}".split())
        try:
            arguments[-1].send(Failure(text, traceback.format_exc()))
        except OSError:
            if not isinstance(error, EOFError | ConnectionError):  # no more than that
                traceback.print_exc()  # nobody else is left to say it
        sys.exit(1)


# A snapshot of the running bench for another process, such as the status line.
#
# The writer never waits: it copies a row with a check sum into shared memory. A reader that meets
# a row half written sees that the sum is wrong and reads again, whatever order the machine's
# caches deliver stores in, and even if the writer was killed in the middle.
#
# The memory has no name in the file system (`multiprocessing.RawArray`), so nothing is left
# behind however either process ends. Hand the `Snapshot` to the reader as an argument of its
# `Process`.


_CHECK_SUM = struct.Struct("<I")


_ATTEMPTS = 100


class SnapshotRow(NamedTuple):
    """One row as the reader sees it.

    Attributes:
        sequence: number of the row, from 1; a higher number is a newer row.
        values: as many values as it is wide.
    """

    sequence: int
    values: tuple[float, ...]


class Snapshot:
    """The newest row of values, shared between one writer and any readers.

    Args:
        width: values of a row.
    """

    def __init__(self, width: int) -> None:
        self._format = f"<Q{width}d"
        self._size = struct.calcsize(self._format)
        self._memory = multiprocessing.RawArray(ctypes.c_char, self._size + _CHECK_SUM.size)
        self._sequence = 0

    def write(self, values: Sequence[float]) -> None:
        """Publish one row: as many values as it is wide."""
        self._sequence += 1
        row = struct.pack(self._format, self._sequence, *values)
        self._memory.raw = row + _CHECK_SUM.pack(zlib.crc32(row))

    def read(self) -> SnapshotRow | None:
        """Return the newest row, or None where there is none yet."""
        for _ in range(_ATTEMPTS):
            memory = self._memory.raw
            row, check_sum = memory[: self._size], memory[self._size :]
            if check_sum == _CHECK_SUM.pack(zlib.crc32(row)):
                sequence, *values = struct.unpack(self._format, row)
                return SnapshotRow(sequence, tuple(values))
        return None
