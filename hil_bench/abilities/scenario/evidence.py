"""The evidence of a run for its report: signals, faults and frames."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Recording
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.outside.recording.plot import Span

MOST_FRAMES = 500_000
"""Frames that a run keeps for its report; of more, the latest."""


class FrameReader(Protocol):
    """Puts frames in words."""

    def name(self, frame: Frame) -> str:
        """Return the names of a frame's device and of its message."""

    def meaning(self, frame: Frame) -> str:
        """Return the meaning of a frame."""

    def news(self, frames: Sequence[LoggedFrame]) -> Iterable[LoggedFrame]:
        """Yield what did not come cyclically."""

    def latest(self, frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Yield the last frame of each identifier that comes cyclically."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence of a run.

    Attributes:
        signals: a row a tick; without rows where nothing was recorded.
        columns: the values of all that the requirements name, shape (ticks,).
        ticks: how many.
        tick_ns: time between two [ns].
        faults: when which fault was there.
        frames: oldest first.
        reader: puts them in words.
        planned: how many ticks the run has; None for one that ends with these.
    """

    signals: Recording
    columns: Mapping[str, Floats]
    ticks: int
    tick_ns: int
    faults: tuple[Span, ...] = ()
    frames: Sequence[LoggedFrame] = ()
    reader: FrameReader | None = None
    planned: int | None = None
