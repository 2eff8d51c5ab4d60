"""Log lines about bad clients: one each, limited to a readable number."""

import logging
from collections.abc import Callable

logger = logging.getLogger(__name__)

INTERVAL = 1.0
"""Shortest time between two lines [s]."""


class Complaints:
    """Logs errors of clients, at most one line each `INTERVAL`.

    Args:
        clock: seconds that never step back.

    Attributes:
        count: errors so far, with those that got no line.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.count = 0
        self._clock = clock
        self._unsaid = 0
        self._quiet_until = -float("inf")

    def add(self, peer: str, reason: str) -> None:
        """Log the error of a client, or count it where there was a line just now."""
        self.count += 1
        now = self._clock()
        if now < self._quiet_until:
            self._unsaid += 1
            return
        more = f" ({self._unsaid} more errors since the last line)" if self._unsaid else ""
        logger.warning("modbus client %s: %s%s", peer, reason, more)
        self._unsaid = 0
        self._quiet_until = now + INTERVAL
