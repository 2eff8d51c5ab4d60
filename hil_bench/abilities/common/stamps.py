"""Time stamps of frames, which most interfaces take from a clock that somebody may set."""

import time
from collections.abc import Callable
from typing import Final

import can

_LEAST_STEP: Final = 0.05
"""A smaller change of the wall clock between two frames is its own correction, not a step [s]."""


class SteadyStamps:
    """Takes the steps of this machine's wall clock out of the stamps of a bus's frames.

    Stamps keep their precision. A step is taken out of them where they made it, too; those of an
    adapter with a clock of its own did not.

    Args:
        wall: the clock that may be set [s].
        steady: one that may not [s].
    """

    def __init__(
        self,
        wall: Callable[[], float] = time.time,  # noqa: TID251 - its jumps are looked for
        steady: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wall, self._steady = wall, steady
        self._offset = wall() - steady()
        self._shift = 0.0
        self._last: tuple[float, float] | None = None

    def straighten(self, message: can.Message) -> can.Message:
        """Return a message that has just come, with the stamp that it would have without steps."""
        now, stamp = self._steady(), message.timestamp
        offset = self._wall() - now
        step = offset - self._offset
        if abs(step) < _LEAST_STEP:
            self._offset = offset
        elif self._last is not None:
            jump = (stamp - self._last[0]) - (now - self._last[1])
            if abs(jump - step) < abs(jump):
                self._offset, self._shift = offset, self._shift + step
        self._last = stamp, now
        message.timestamp = stamp - self._shift
        return message
