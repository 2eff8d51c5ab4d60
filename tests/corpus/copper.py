"""Times of frames on copper: each takes its bits, and waits for the one before it."""

from collections.abc import Sequence

from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.outside.recording.channels import LoggedFrame

_NS = 1_000_000_000


def timed_like_copper(frames: Sequence[LoggedFrame], bitrate: int) -> list[LoggedFrame]:
    """Return the frames in their order, at the times at which a bus of a bit rate has them whole.

    Args:
        frames: of a bus that takes no time.
        bitrate: of the bus [bit/s].
    """
    free, timed = 0, []
    for logged in frames:
        free = max(free, logged.now) + exact_bits(logged.frame) * _NS // bitrate
        timed.append(logged._replace(now=free))
    return timed
