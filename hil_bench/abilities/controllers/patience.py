"""Patience with code that does not come back: so much processor time, or so long without any.

Processor time is its own, so a busy machine does not change what is said of it.
"""

import enum
import time
from typing import Final

from hil_bench.abilities.common.processes import read_status

_OF_PROCESS: Final = 2
_OF_THREAD: Final = 6
"""Low bits of the numbers that Linux gives the clocks of processor time."""


class Lapse(enum.Enum):
    """The reason for which patience has come to its end."""

    COMPUTES = enum.auto()
    IDLES = enum.auto()


class Patience:
    """The patience with a process, or with a thread.

    Args:
        number: of it, as the system counts.
        cpu_s: processor time that it may take from the first look on [s].
        idle_s: time for which it may neither take any nor wait for a processor [s].
        is_thread: whether it is a thread of this process.
    """

    def __init__(
        self, number: int, cpu_s: float, idle_s: float, *, is_thread: bool = False
    ) -> None:
        self._number, self._cpu_s, self._idle_s = number, cpu_s, idle_s
        self._clock = ~number << 3 | (_OF_THREAD if is_thread else _OF_PROCESS)
        self._first = self._last = -1.0
        self._idle_since = 0.0

    def find_lapse(self) -> Lapse | None:
        """Look at it; return why patience is at its end, None while it is not.

        Where it has just ended, or the system does not know it, patience lasts.
        """
        try:
            used, state = time.clock_gettime(self._clock), read_status(self._number).state
        except (OSError, AttributeError):
            return None
        now = time.monotonic()
        if self._first < 0.0:
            self._first = used
        if used != self._last or state == "R":
            self._last, self._idle_since = used, now
        if used - self._first > self._cpu_s:
            return Lapse.COMPUTES
        return Lapse.IDLES if now - self._idle_since > self._idle_s else None
