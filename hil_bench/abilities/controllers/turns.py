"""One processor for two processes that take turns.

Of two that wait for each other one runs at a time. On an idle machine the kernel gives each a
processor of its own all the same, where each turn wakes one from its sleep: 25 us on a virtual
machine, and a switch on one processor takes 3. So both stay on one, except for one turn in
`PERIOD`, in which the kernel may move them to where there is room.
"""

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from hil_bench.outside.realtime import linux

PERIOD: Final = 512
"""Turns from one in which the kernel may move both to the next."""


class _Tie(NamedTuple):
    """A thread on one processor, and those on which it may run otherwise.

    The threads that it starts meanwhile inherit the processor.
    """

    thread: int
    processor: set[int]
    others: set[int]


class Turns:
    """The turns of this thread and of processes that live only while it waits for them.

    One with several threads may run while this thread does, and is left alone; so is a thread that
    somebody else has tied. Where the kernel refuses, all run where they like.
    """

    def __init__(self) -> None:
        self._count = 1  # none of the first `PERIOD`: some are starting
        self._ties: list[_Tie] = []

    def take(self, pids: Callable[[], Sequence[int]]) -> None:
        """Begin a turn.

        Args:
            pids: returns the processes; seldom asked.
        """
        self._count += 1
        place = self._count % PERIOD
        if place == 0:
            self.end()
        elif place == 1 and (single := [pid for pid in pids() if len(linux.threads(pid)) == 1]):
            with contextlib.suppress(OSError):
                processor = linux.processor()
                for thread in (threading.get_native_id(), *single):
                    self._tie(thread, processor)

    def end(self) -> None:
        """Let all run where they may."""
        ties, self._ties = self._ties, []
        for tied, processor, others in ties:
            for thread in linux.threads(tied):
                with contextlib.suppress(OSError):  # it has ended
                    if os.sched_getaffinity(thread) == processor:
                        os.sched_setaffinity(thread, others)

    def _tie(self, thread: int, processor: int) -> None:
        may = os.sched_getaffinity(thread)
        if processor in may and len(may) > 1:
            os.sched_setaffinity(thread, {processor})
            self._ties.append(_Tie(thread, {processor}, may))
