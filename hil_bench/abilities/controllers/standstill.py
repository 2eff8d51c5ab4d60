"""Controllers in the bench's own thread that never come back, and the end that they are given.

A thread beside the bench looks at them once a second. Python code it interrupts, which is an error
of the controller like any other. Machine code nobody can interrupt: the process says so in a line,
does what others need at its end, and is over.
"""

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from hil_bench.abilities.common.processes import is_traced
from hil_bench.abilities.controllers.patience import Lapse, Patience
from hil_bench.outside import signals

USUAL_PATIENCE: Final = 60.0
"""Time of a call of a controller, where its table gives no other [s]."""

GLANCE = 1.0
"""Time between two looks [s]."""

GRACE = 2.0
"""Time that is left behind a signal that asks for the end, as Ctrl-C is [s]."""

LONGEST_FAREWELL: Final = 10.0
"""Time that the end of the process may take [s]."""

_DEBUGGERS: Final = {"bdb", "pdb", "pydevd", "_pydevd_bundle"}
"""Modules that have a thread while somebody looks at it: pdb and its kin, debugpy, PyCharm."""

_MOST_TRIES = 3
"""How often Python code is interrupted, which may take that for its own."""


class Overdue(BaseException):
    """Raised in Python code that does not come back; the words say for how long."""


class Guard:
    """The guard of a controller in the bench's thread.

    Args:
        place: how messages begin.
        longest: processor time, or time without any, that a call may take [s].
        is_native: whether it is machine code.
        farewell: does what others need before the process ends, called by another thread.

    Attributes:
        until: the bench time that it is asked to live to [ns]; None while it is not at work.
    """

    def __init__(
        self, place: str, longest: float, *, is_native: bool, farewell: Callable[[], None]
    ) -> None:
        self.until: int | None = None
        self.is_native = is_native
        self._place, self._longest, self._farewell = place, longest, farewell
        self._ident = self._thread = 0
        self._seen: int | None = None
        self._patience: Patience | None = None
        self._asked: tuple[int, float] | None = None
        self._tries, self._tried = 0, 0.0
        self._problem = ""

    def begin(self) -> None:
        """Take this thread for that of the bench."""
        self._ident, self._thread = threading.get_ident(), threading.get_native_id()

    def look(self) -> None:
        """See whether it is still where it was at the last look, and for how long."""
        until, patience = self.until, self._patience
        if until is None or patience is None or until != self._seen or is_debugged(self._ident):
            self._seen, self._tries = until, 0
            self._patience = Patience(self._thread, self._longest, self._longest, is_thread=True)
            self._patience.find_lapse()
            return
        longest = f"{self._longest:g} s"
        right = f"let it return when it has lived until then, or give patience_s above {longest}"
        match patience.find_lapse():
            case Lapse.COMPUTES:
                self._end(until, f"it took {longest} of processor time; {right}")
            case Lapse.IDLES:
                self._end(until, f"it waited for {longest}; {right}")
            case None if self._asked is not None and self._asked[0] == until:
                if time.monotonic() - self._asked[1] >= GRACE:
                    self._end(until, "the end was asked for, and it held the bench")

    def ask(self) -> None:
        """Take note that somebody asks for the end."""
        self._asked = None if self.until is None else (self.until, time.monotonic())

    def take_problem(self) -> str:
        """Return why it is to be interrupted, once; empty where it has come back meanwhile."""
        problem, self._problem = self._problem, ""
        return problem if self.until is not None and self.until == self._seen else ""

    def _end(self, until: int, why: str) -> None:
        words = f"at {until * 1e-9:.3f} s the controller did not come back: {why}"
        is_main = self._ident == threading.main_thread().ident
        if time.monotonic() - self._tried < GRACE:  # it may be on its way
            return
        if self.is_native or not (is_main and signals.can_wake()) or self._tries == _MOST_TRIES:
            leave(f"{self._place}{words}", self._farewell)
            return
        self._tries, self._tried = self._tries + 1, time.monotonic()
        self._problem = words
        signals.wake()


def is_debugged(ident: int) -> bool:
    """Return True if a debugger has this process, or a thread of it stands in one of Python."""
    frame = sys._current_frames().get(ident)  # noqa: SLF001 - the documented way
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _DEBUGGERS:
            return True
        frame = frame.f_back
    return is_traced()


def _look() -> None:
    while True:
        time.sleep(GLANCE)
        for guard in tuple(_guards):
            guard.look()


def _pass_on(number: int) -> None:
    if number in signals.ENDING:
        for guard in tuple(_guards):
            guard.ask()


_guards: list[Guard] = []
_wishes = {"watch": True}
_watches: list[threading.Thread] = []


def watch(guard: Guard) -> None:
    """Look at a guard from now on."""
    if not _wishes["watch"]:
        return
    guard.begin()
    if guard not in _guards:
        _guards.append(guard)
    if threading.current_thread() is threading.main_thread():
        signals.attend()
    if not _watches or not _watches[-1].is_alive():
        signals.add_listener(_pass_on)
        signals.add_visitor(_interrupt)
        _watches[:] = [threading.Thread(target=_look, name="hil-bench watch", daemon=True)]
        _watches[-1].start()


def unwatch(guard: Guard) -> None:
    """Look at a guard no longer."""
    if guard in _guards:
        _guards.remove(guard)


def watch_nothing() -> None:
    """Look at nothing in this process, a copy by fork: it needs no further thread to be copied."""
    _wishes["watch"] = False
    _guards.clear()
    signals.attend_no_more()


def _interrupt() -> None:
    for guard in tuple(_guards):
        if problem := guard.take_problem():
            raise Overdue(problem)


# The end of a process in which machine code does not come back.

_ERRORS = [2]
"""The descriptors of standard error, whoever captures it; the last one counts."""

_leaving: list[Callable[[str], None]] = []


def leave(words: str, farewell: Callable[[], None] = lambda: None) -> None:
    """Say why the process ends, let others have what they need, and end it.

    Args:
        words: a line.
        farewell: called before; where it takes too long, the process ends without.
    """
    from hil_bench.cli.exit_codes import ExitCode  # noqa: PLC0415 - pytest loads this module early

    last = threading.Timer(LONGEST_FAREWELL, os._exit, (int(ExitCode.BUS),))
    last.daemon = True
    last.start()
    say(words)
    with suppress(Exception):
        farewell()
    for report in _leaving:
        report(words)
    os._exit(int(ExitCode.BUS))


def say(words: str) -> None:
    """Write an error on standard error, whoever captures it."""
    if not _leaving:
        with suppress(OSError):
            os.write(_ERRORS[-1], f"hil-bench: error: {words}\n".encode())


def report_instead(report: Callable[[str], None]) -> None:
    """Have the words reported to another process, which ends this one, not on standard error."""
    _leaving.append(report)


def keep_errors() -> None:
    """Take standard error as it is now for that of this process, before others capture it."""
    with suppress(OSError):
        _ERRORS.append(os.dup(2))


def drop_errors() -> None:
    """Let go of what `keep_errors` has taken."""
    if len(_ERRORS) > 1:
        os.close(_ERRORS.pop())
