"""Signals that the main thread hears even where it waits.

Python calls the handler of a signal in the main thread, between two of its instructions. A signal
that comes just before a call that waits, such as the read of a pipe, does not end that call, and
its handler is called when the call is over, which may be never. A thread hears of the signal at
once, and wakes the main thread a little later.
"""

import os
import select
import signal
import threading
from collections.abc import Callable
from typing import Any, Final

ENDING: Final = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
)
"""Signals by which a terminal, a session or a service manager ends all its processes at once."""

_WAKES: Any = getattr(signal, "SIGURG", None)  # ignored where nobody has a use for it

_DELAYS: Final = (0.01, 0.1, 1.0)
"""Times behind a signal at which the main thread is woken [s]; each may come too early."""

_listeners: list[Callable[[int], None]] = []
_visitors: list[Callable[[], None]] = []
_pipe: list[int] = []


def attend() -> None:
    """Have each signal with a handler heard from now on; main thread only.

    Another loop that hears signals, such as a notebook's, keeps them.
    """
    if _WAKES is not None and signal.getsignal(_WAKES) == signal.SIG_DFL:
        signal.signal(_WAKES, _visit)
    if not _pipe:
        _pipe.extend(os.pipe())
        os.set_blocking(_pipe[1], False)
        threading.Thread(target=_listen, name="hil-bench signals", daemon=True).start()
    before = signal.set_wakeup_fd(_pipe[1], warn_on_full_buffer=False)
    if before not in {-1, _pipe[1]}:
        signal.set_wakeup_fd(before)


def add_listener(listener: Callable[[int], None]) -> None:
    """Have a thread call it with the number of each signal; it must not wait."""
    _listeners.append(listener)


def add_visitor(visitor: Callable[[], None]) -> None:
    """Have the main thread call it whenever it is woken; what it raises interrupts that thread."""
    _visitors.append(visitor)


def can_wake() -> bool:
    """Return True if the main thread can be woken."""
    return _WAKES is not None and signal.getsignal(_WAKES) is _visit


def wake() -> None:
    """Wake the main thread from a call that waits, which goes on unless a handler raises."""
    signal.pthread_kill(threading.main_thread().ident or 0, _WAKES)


def attend_no_more() -> None:
    """Hear nothing in this process, a copy by fork: the pipe is its parent's."""
    if _pipe:
        signal.set_wakeup_fd(-1)
    _pipe.clear()


def _visit(_number: int, _frame: object) -> None:
    for each in tuple(_visitors):
        each()


def _listen() -> None:
    delays: tuple[float, ...] = ()
    while True:
        if select.select(_pipe[:1], [], [], *delays[:1])[0]:
            for number in os.read(_pipe[0], 256):
                if number != _WAKES:
                    delays = _DELAYS
                    for each in tuple(_listeners):
                        each(number)
        else:
            delays = delays[1:]
            if can_wake():
                wake()
