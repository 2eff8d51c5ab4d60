"""Signals that ask for the end: Ctrl-C, SIGTERM, SIGQUIT, and SIGHUP of a terminal that closes.

A loop asks for them between two ticks, so that it ends in order; what moves a machine is
interrupted at once and closes the valve. SIGHUP stays ignored where `nohup` has it ignored.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.streams import discard_lost_terminal

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
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
    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    for number, present in before.items():
        if present is not signal.SIG_IGN or number == signal.SIGINT:  # as of a shell's "&"
            signal.signal(number, handler)
    try:
        yield
    finally:
        for number, present in before.items():
            signal.signal(number, present)
