"""Error counters on a dominant bus, and the recovery of a station (ISO 11898-1)."""

from collections.abc import Callable
from typing import Final

from hil_bench.abilities.copper.wire.attempt import FLAG

SEQUENCES: Final = 128
SEQUENCE: Final = 11
"""A station that was bus-off is back after 128 sequences of 11 recessive bits."""

_TOLERATED: Final = 14
_MORE: Final = 8


class Absence:
    """Counts the recessive sequences that a station waits for which is bus-off.

    Args:
        asked_at: when its software asks for the recovery [ns].
    """

    __slots__ = ("asked_at", "left", "since")

    def __init__(self, asked_at: int) -> None:
        self.asked_at = asked_at
        self.since = asked_at
        self.left = SEQUENCES

    def back_at(self, free_at: int, bits: Callable[[int], int]) -> int:
        """Return when it is back if the bus stays idle [ns]."""
        return max(self.since, free_at) + bits(self.left * SEQUENCE)

    def see(self, begin: int, end: int, bits: Callable[[int], int]) -> None:
        """Take note of a transmission; idle bits before it, and 11 at its end, are recessive."""
        if end <= self.asked_at:
            return
        idle = max(0, begin - self.since)
        self.left = max(0, self.left - idle // bits(SEQUENCE) - 1)
        self.since = end

    def begin_anew(self, now: int) -> None:
        """Wait for all of them from now on [ns]: a dominant bus has none."""
        self.since = max(self.asked_at, now)


def dominant_errors(bits: int, *, is_sender: bool) -> int:
    """Return the increment of an error-active station's counter for dominant bits in a row.

    A sender notices at the first bit, a receiver at the sixth by the rule of stuffing. Six bits of
    the error flag follow; a dominant bit behind it counts 8 for a receiver, and so do for all the
    fourteenth from the begin of the flag, and each eighth after that.
    """
    if is_sender:
        begin, errors = 1, 8
    else:
        begin, errors = FLAG, 1
    if bits < begin:
        return 0
    since = bits - begin
    if since > FLAG and not is_sender:
        errors += 8
    if since >= _TOLERATED:
        errors += 8 * (1 + (since - _TOLERATED) // _MORE)
    return errors
