"""Two producers of SYNC: every other one comes with a period, and the sequence of all with none."""

from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from statistics import median
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.sight import Sight

_LENGTH: Final = 32
"""Intervals that are looked at together ..."""
_EVERY: Final = 8
"""... and SYNCs between two looks."""

_EVEN: Final = 0.06
_ALIKE: Final = 0.2
"""How far intervals may be off for a period, of it: those of every other SYNC, those of all."""

_MANY: Final = 0.8
_FEW: Final = 0.6
_DRIFT: Final = 0.03
"""Change of the time between the two from third to third of a look [periods]: two clocks."""


class Producers(NamedTuple):
    """Two producers.

    Attributes:
        sight: the first SYNC of the look that showed them.
        period: of each of them [ns].
    """

    sight: Sight
    period: float


class SyncProducers:
    """Follows the times of SYNC.

    Attributes:
        found: the two producers, once there was proof; None before.
    """

    def __init__(self) -> None:
        self.found: Producers | None = None
        self._sights: deque[Sight] = deque(maxlen=_LENGTH + 1)
        self._count = 0
        self._settled = 0.0

    def hear(self, sight: Sight, periods: Iterable[float]) -> None:
        """Take a SYNC.

        Args:
            sight: the SYNC.
            periods: those that nodes were given by 0x1006 [ns].
        """
        self._sights.append(sight)
        self._count += 1
        is_due = len(self._sights) > _LENGTH and self._count % _EVERY == 0
        if is_due and self.found is None:
            self._look(periods)

    def _look(self, periods: Iterable[float]) -> None:
        times = [sight.now for sight in self._sights]
        ones = [after - before for before, after in pairwise(times)]
        twos = [after - before for before, after in zip(times, times[2:], strict=False)]
        middle, period = median(ones), median(twos)
        if _share(ones, middle, _ALIKE) >= _MANY:
            self._settled = middle
            return
        if _share(twos, period, _EVEN) < _MANY or _share(ones, period / 2, _ALIKE) >= _FEW:
            return
        known = self._settled, *periods
        is_known = any(abs(each - period) <= _ALIKE / 2 * period for each in known)
        if is_known or _drifts(ones[::2], _DRIFT * period):
            self.found = Producers(self._sights[0], period)


def _share(intervals: list[int], period: float, tolerance: float) -> float:
    alike = sum(abs(each - period) <= tolerance * period for each in intervals)
    return alike / len(intervals)


def _drifts(phases: list[int], step: float) -> bool:
    """Return True if times become longer and longer, or shorter and shorter."""
    third = len(phases) // 3
    first, second, last = (median(phases[k * third : (k + 1) * third]) for k in range(3))
    return min(second - first, last - second) > step or max(second - first, last - second) < -step
