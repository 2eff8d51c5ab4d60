"""The reader of a bench's frames that an ability brings, for reports."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.logged_frame import LoggedFrame


class FrameReader(Protocol):
    """Puts frames in words."""

    def name(self, frame: Frame) -> str:
        """Return a frame's sender and name."""

    def meaning(self, frame: Frame) -> str:
        """Return the content of a frame in words."""

    def news(self, frames: Sequence[LoggedFrame]) -> Iterable[LoggedFrame]:
        """Yield the frames that did not come cyclically."""

    def latest(self, frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Yield the last frame of each identifier that comes cyclically."""
