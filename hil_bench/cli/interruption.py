"""Ctrl-C and SIGTERM as a wish that the loop asks for, so that it ends between two ticks."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Whether somebody asked this process to stop.

    Attributes:
        requested: set by the signal handlers.
    """

    def __init__(self) -> None:
        self.requested = False

    def request(self, _signal: int = 0, _frame: FrameType | None = None) -> None:
        """Ask for the end; a second request does not wait for it.

        Raises:
            KeyboardInterrupt: it was asked for before.
        """
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True


@contextmanager
def interruption() -> Iterator[Interruption]:
    """Turn SIGINT and SIGTERM into requests for the time of the block.

    Yields:
        What the signals set.
    """
    wish = Interruption()
    before = {number: signal.signal(number, wish.request) for number in _SIGNALS}
    try:
        yield wish
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_SIGNALS = (signal.SIGINT, signal.SIGTERM)
