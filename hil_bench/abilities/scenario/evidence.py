"""The evidence of a run for its report: signals, faults and frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.outside.recording.channels import Recording
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.outside.recording.spans import Span
from hil_bench.session.frame_reader import FrameReader

MOST_FRAMES = 500_000
"""Frames that a run keeps for its report; of more, the latest."""


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
