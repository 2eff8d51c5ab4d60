"""Exit codes of verbs, their errors, and interruptions."""

import argparse
import errno
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType

from hil_bench.cli.process import discard_lost_terminal, discard_output
from hil_bench.errors import (
    DISK_FAULTS,
    BusError,
    ConfigError,
    ControllerError,
    DiskError,
    HilBenchError,
    NothingSeenError,
    RecordingError,
    TimingError,
    WaitTimeoutError,
)
from hil_bench.outside import signals
from hil_bench.registry import owner_of

# Exit codes of `hil-bench`: their meanings, their order of severity, and the end of a verb.


class ExitCode(IntEnum):
    """Exit codes of every verb; never a count and never an errno."""

    DONE = 0
    """The verb did what it was asked."""
    CHECK_FAILED = 1
    """The verb ran, and what it checked is not as it should be."""
    USAGE = 2
    """The command line, the configuration or a file is wrong."""
    BUS = 3
    """A bus or a port could not be opened, or was lost; a bench or a controller is silent."""
    TIMING = 4
    """The real-time budget was missed under ``--strict-timing`` or ``--overrun stop``."""
    LOST = 5
    """Output was lost: a recording, a report, standard output, a Modbus server."""
    INCONCLUSIVE = 6
    """The verb ran, but what it was to check could not be seen."""
    INTERNAL = 70
    """A bug of hil-bench itself, or of what extends it (EX_SOFTWARE of the BSD ``sysexits``)."""
    INTERRUPTED = 130
    """Ended by Ctrl-C before it was done (128 + SIGINT, as shells count)."""


SEVERITY = (
    ExitCode.INTERNAL,
    ExitCode.BUS,
    ExitCode.CHECK_FAILED,
    ExitCode.USAGE,
    ExitCode.LOST,
    ExitCode.TIMING,
    ExitCode.INTERRUPTED,
    ExitCode.INCONCLUSIVE,
    ExitCode.DONE,
)
"""The worst first; docs/exit-codes.md has the reasons."""


_CODES_OF_ERRORS = {
    DiskError: ExitCode.LOST,  # before ConfigError, which it is, too
    RecordingError: ExitCode.LOST,
    ConfigError: ExitCode.USAGE,
    BusError: ExitCode.BUS,
    ControllerError: ExitCode.BUS,
    WaitTimeoutError: ExitCode.BUS,
    TimingError: ExitCode.TIMING,
    NothingSeenError: ExitCode.INCONCLUSIVE,
}

_CODES_OF_NUMBERS = {
    **dict.fromkeys(DISK_FAULTS, ExitCode.LOST),
    errno.EMFILE: ExitCode.USAGE,
    errno.EROFS: ExitCode.USAGE,
}


def worst(*codes: ExitCode) -> ExitCode:
    """Return the exit code of a verb to which several things have happened."""
    return min(codes, key=SEVERITY.index, default=ExitCode.DONE)


def verdict_code(*, fails: bool, passes: bool) -> ExitCode:
    """Return the exit code of a judgement, undecided where it neither fails nor passes."""
    if fails:
        return ExitCode.CHECK_FAILED
    return ExitCode.DONE if passes else ExitCode.INCONCLUSIVE


def exit_code_of(error: Exception) -> ExitCode:
    """Return the exit code for an error that ended a verb."""
    if isinstance(error, OSError) and not isinstance(error, HilBenchError):
        return _CODES_OF_NUMBERS.get(error.errno or 0, ExitCode.INTERNAL)
    if _missing_extra(error):
        return ExitCode.USAGE
    found = (code for kind, code in _CODES_OF_ERRORS.items() if isinstance(error, kind))
    return next(found, ExitCode.INTERNAL)


def _missing_extra(error: Exception) -> str:
    """Return the optional package whose absence is the error; empty for any other error."""
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return ""
    from importlib.metadata import requires  # noqa: PLC0415 - for this alone

    package = error.name.partition(".")[0]
    own = [each for each in requires("hil-bench") or () if "extra == 'all'" in each]
    return package if any(re.match(rf"{re.escape(package)}\b", each) for each in own) else ""


def report_error(error: Exception, *, verbosity: int) -> ExitCode:
    """Print an error on standard error, a line a problem, and return its exit code."""
    if verbosity >= 2:
        traceback.print_exception(error)
    text, code = str(error), exit_code_of(error)
    if isinstance(error, HilBenchError):
        pass
    elif missing := _missing_extra(error):
        text = f"needs {missing}, which is missing; pip install 'hil-bench[all]' brings it"
    elif isinstance(error, OSError) and code is not ExitCode.INTERNAL:
        text = f"{error.filename or 'standard output'}: {error.strerror}"
        if not error.filename:
            discard_output()
    else:
        owner = owner_of(error)
        text = f"{owner}: " * bool(owner) + f"{type(error).__name__}: {error}"
        if verbosity < 2:
            text += "; this is a bug, please report it with the output of the same command and -vv"
    for line in text.splitlines():
        print(f"hil-bench: error: {line}", file=sys.stderr)
    return code


class Ending:
    """Collects what happens to a verb, so that no later event hides an earlier one.

    Args:
        args: the command line.

    Attributes:
        code: the worst exit code so far.
    """

    def __init__(self, args: argparse.Namespace) -> None:
        self.code = ExitCode.DONE
        self._verbosity: int = args.verbose

    def take(self, *codes: ExitCode) -> None:
        """Count exit codes."""
        self.code = worst(self.code, *codes)

    def take_error(self, error: Exception | None) -> None:
        """Print an error, and count it; nothing for None."""
        if error is not None:
            self.take(report_error(error, verbosity=self._verbosity))

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Print and count an error of the block, and go on behind it.

        A reader of standard output that has seen enough, such as `head`, is no error.

        Yields:
            Nothing.
        """
        try:
            yield
        except BrokenPipeError:
            discard_output()
        except (HilBenchError, OSError) as error:
            self.take_error(error)


# Signals that ask for the end: Ctrl-C, SIGTERM, SIGQUIT, and SIGHUP of a terminal that closes.
#
# A loop asks for them between two ticks, so that it ends in order; what moves a machine is
# interrupted at once and closes the valve. SIGHUP stays ignored where `nohup` has it ignored.

_AGAIN = 0.01
"""Time after which an interruption that was lost comes again [s]."""
_Handler = Callable[[int, FrameType | None], None]


class Interruption:
    """A request to stop this process.

    Attributes:
        requested: set by the signal handlers.
    """

    def __init__(self) -> None:
        self.requested = False
        self.is_postponed = False

    @property
    def code(self) -> ExitCode:
        """The exit code of a verb that nothing worse happened to."""
        return ExitCode.INTERRUPTED if self.requested else ExitCode.DONE

    def request(self, number: int = 0, _frame: FrameType | None = None) -> None:
        """Ask for the end; a second Ctrl-C does not wait for it.

        Other signals may come twice for one cause: a terminal that closes sends SIGHUP by the
        kernel and by the shell.

        Raises:
            KeyboardInterrupt: the end was asked for before, and this is Ctrl-C.
        """
        if number == getattr(signal, "SIGHUP", None):
            discard_lost_terminal()
        if self.requested and number in {0, signal.SIGINT}:
            raise KeyboardInterrupt
        self.requested = True

    def interrupt(self, number: int, _frame: FrameType | None) -> None:
        """Ask for the end by a KeyboardInterrupt; later signals change nothing.

        Raises:
            KeyboardInterrupt: the end was not asked for before.
        """
        if not self.requested and not self.is_postponed:
            self.request(number)
            raise KeyboardInterrupt


@contextmanager
def interruption() -> Iterator[Interruption]:
    """Turn signals into a wish for the time of the block.

    Yields:
        What the signals set.
    """
    wish = Interruption()
    with _handling(wish.request):
        yield wish


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Have the first signal raise KeyboardInterrupt; no further one disturbs what it leads to.

    Yields:
        Nothing.
    """
    wish = Interruption()
    signals.attend()
    with _handling(wish.interrupt), _coming_again(wish):
        yield


@contextmanager
def _coming_again(wish: Interruption) -> Iterator[None]:
    """Have an interruption come again that Python ignored, as it does what a finaliser raises."""
    before, main = sys.unraisablehook, threading.main_thread().ident or 0
    has_ended = threading.Event()

    def ask() -> None:
        while not has_ended.wait(_AGAIN) and not wish.requested:
            signal.pthread_kill(main, signal.SIGINT)

    def look(lost: "sys.UnraisableHookArgs") -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            before(lost)
            return
        wish.requested, wish.is_postponed = False, True  # in this hook it would be lost again
        threading.Thread(target=ask, daemon=True).start()
        wish.is_postponed = False

    sys.unraisablehook = look
    try:
        yield
    finally:
        sys.unraisablehook = before
        has_ended.set()


@contextmanager
def _handling(handler: _Handler) -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in signals.ENDING}
    for number, present in before.items():
        if present is not signal.SIG_IGN or number == signal.SIGINT:  # as of a shell's "&"
            signal.signal(number, handler)
    try:
        yield
    finally:
        for number, present in before.items():
            signal.signal(number, present)
