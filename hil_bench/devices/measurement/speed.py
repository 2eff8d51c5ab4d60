"""Speed as a position sensor finds it: from the positions that it has measured."""

from collections import deque


class SpeedEstimate:
    """Mean speed over the latest samples of a position.

    Args:
        window: over which the mean is taken [s]; at least one period of the samples is.
        period: between two samples [s].

    Attributes:
        value: the mean speed; 0 before there is a second sample.
    """

    def __init__(self, window: float, period: float) -> None:
        intervals = max(1, round(window / period))
        self._positions: deque[float] = deque(maxlen=intervals + 1)
        self._period = period
        self.value = 0.0

    def take(self, position: float) -> None:
        """Take the next sample."""
        positions = self._positions
        positions.append(position)
        if len(positions) > 1:
            self.value = (position - positions[0]) / ((len(positions) - 1) * self._period)
