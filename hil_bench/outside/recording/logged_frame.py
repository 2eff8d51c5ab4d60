"""A frame as a recording holds it."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from hil_bench.canopen_device.frame import Frame


class LoggedFrame(NamedTuple):
    """A frame that was on the bus.

    Attributes:
        frame: the frame.
        now: when it was on the bus, on the recording's time base [ns].
        is_received: whether the recording side received it; False where it sent it, None where the
            file does not say.
    """

    frame: Frame
    now: int
    is_received: bool | None


def from_first(frames: Iterable[LoggedFrame]) -> Iterator[LoggedFrame]:
    """Count times from the first frame: logs of real buses have the date.

    Yields:
        The frames.
    """
    first: int | None = None
    for logged in frames:
        first = logged.now if first is None else first
        yield logged._replace(now=logged.now - first)
