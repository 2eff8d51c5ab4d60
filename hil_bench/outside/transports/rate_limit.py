"""A limit on a program's frames on a hub: as many as a bus of some bit rate carries."""

BURST = 10_000_000
"""Time on the bus of the frames that a program may send at once after it was quiet [ns]."""

_NS_PER_S = 1_000_000_000


class RateLimit:
    """The account of one program, by the time that is passed in.

    Args:
        bitrate: of the bus [bit/s].
    """

    def __init__(self, bitrate: float) -> None:
        self._time_of_bit = _NS_PER_S / bitrate
        self._free_at = 0.0

    def delay(self, now: int) -> float:
        """Return the time until the next frame may be sent [ns], 0 for at once.

        Args:
            now: the time, on any clock that never steps back [ns].
        """
        return max(0.0, self._free_at - BURST - now)

    def take(self, bits: float, now: int) -> None:
        """Account for a frame of so many bits that is sent now [ns]."""
        self._free_at = max(self._free_at, now) + bits * self._time_of_bit
