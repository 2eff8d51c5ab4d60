"""The load of a bus: the share of its time that frames take."""

from collections import deque

USUAL_BITRATE = 1_000_000
"""Bit rate that a load refers to where nobody says another one [bit/s]; a vcan has none at all."""

WINDOW = 1_000_000_000
"""Time over which a present load is taken [ns]."""

_PARTS = 10


class BusLoad:
    """The load of the last second, from a count of bits that grows.

    Args:
        bitrate: of the bus [bit/s].
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._seen: deque[tuple[int, float]] = deque(maxlen=_PARTS + 1)
        self._due = 0
        self._load = 0.0

    @property
    def due(self) -> int:
        """When the next count is wanted [ns], for a load that is that of the last second."""
        return self._due

    def update(self, now: int, bits: float) -> float:
        """Return the load [-], new ten times a second.

        Args:
            now: the time [ns].
            bits: on the bus since it was opened.
        """
        if now >= self._due:
            self._due = now + WINDOW // _PARTS
            self._seen.append((now, bits))
            begin, bits_before = self._seen[0]
            if now > begin:
                self._load = load_of(bits - bits_before, now - begin, self._bitrate)
        return self._load


def load_of(bits: float, duration: int, bitrate: int) -> float:
    """Return the load [-] of bits in a duration [ns] at a bit rate [bit/s]."""
    return bits / (bitrate * duration * 1e-9) if duration else 0.0


def bitrate_text(bitrate: int) -> str:
    """Return a bit rate for people: ``500 kbit/s``."""
    return f"{bitrate / 1e6:g} Mbit/s" if bitrate >= 1_000_000 else f"{bitrate / 1e3:g} kbit/s"
