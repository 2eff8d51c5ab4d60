"""The deviation of a machine from its twin."""

import math
from dataclasses import dataclass


@dataclass(slots=True)
class Residual:
    """Machine less twin of one quantity over a window.

    A device that sends by event sends most while its value moves. So each residual counts for the
    time that it stands for, not for its number of frames.

    Attributes:
        count: values compared.
        time: what they stand for [s].
        squares: integral of the residual's square over that time.
        largest: largest residual in size.
    """

    count: int = 0
    time: float = 0.0
    squares: float = 0.0
    largest: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square over time; NaN without any value."""
        if not self.count:
            return math.nan
        return math.sqrt(self.squares / self.time) if self.time else self.largest

    def add(self, residual: float, duration: float) -> None:
        """Take one residual, which stands for the time [s] since the one before."""
        self.count += 1
        self.time += duration
        self.squares += residual * residual * duration
        self.largest = max(self.largest, abs(residual))
