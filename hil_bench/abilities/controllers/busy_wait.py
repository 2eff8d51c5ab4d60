"""Waiting for an answer that comes soon, without sleep where nobody else wants the processor.

A process that sleeps wakes some 25 us behind what it waits for: half as long as a simulated chip
works in a tick.
"""

import os
import select
import time
from typing import Final

LONGEST_NS: Final = 200_000
"""For which nobody sleeps; what takes longer may be heard later, too."""

SHARED_NS: Final = 25_000
"""Behind which a processor that was offered to others comes back only if one has taken it."""

MOST_SLEEPS: Final = 128
"""Waits that are sleep where each that is not is in vain, or keeps others from the processor.

One that is so after many that were not is followed by a single sleep.
"""

_CAN_OFFER: Final = hasattr(os, "sched_yield")  # on Linux


class BusyWait:
    """Waits for a descriptor.

    Args:
        descriptor: on which something will come.
    """

    def __init__(self, descriptor: int) -> None:
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLIN)
        self._sleeps, self._next_sleeps = 0, 1

    def wait(self) -> None:
        """Return as soon as something is there, or when it is better to sleep until it is."""
        if self._sleeps or not _CAN_OFFER:
            self._sleeps = max(self._sleeps - 1, 0)
            return
        begin = before = time.perf_counter_ns()
        while not self._poll.poll(0):
            os.sched_yield()
            now = time.perf_counter_ns()
            if now - before > SHARED_NS or now - begin > LONGEST_NS:
                self._sleeps = self._next_sleeps
                self._next_sleeps = min(2 * self._next_sleeps, MOST_SLEEPS)
                return
            before = now
        self._next_sleeps = max(self._next_sleeps // 2, 1)
