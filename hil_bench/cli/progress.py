"""How a run goes, in a line now and then, where there is no terminal for status lines."""

from collections.abc import Callable, Sequence
from time import monotonic_ns

PERIOD = 60_000_000_000
"""Time between two lines, on the machine's clock [ns]."""

_NS_PER_S = 1_000_000_000


class Progress:
    """Says how a run goes.

    Args:
        say: takes each line.
        lines: returns what the status lines would show at a bench time [ns].
        clock: of the machine [ns].
    """

    def __init__(
        self,
        say: Callable[[str], None],
        lines: Callable[[int], Sequence[str]],
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._say = say
        self._lines = lines
        self._clock = clock
        self._due = clock() + PERIOD

    def look(self, now: int) -> None:
        """Say how it goes, where it is time; to be called often.

        Args:
            now: bench time [ns].
        """
        present = self._clock()
        if present >= self._due:
            self._due = present + PERIOD
            self._say(f"{now / _NS_PER_S:.3f} s: {'  '.join(self._lines(now))}")
