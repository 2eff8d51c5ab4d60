"""Recorders inside the process: of a bench, and of a network."""

import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from hil_bench.abilities.recording.recorder import BLOCK_PERIOD, Recorder, RecordingPlan, warn
from hil_bench.abilities.recording.report import RecordingReport
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.messages import frame_of
from hil_bench.outside.recording.logged_frame import LoggedFrame

if TYPE_CHECKING:
    import can

# A recording written by the one whose ticks it records: for virtual time, which can wait.


class RowSink(Protocol):
    """Takes rows."""

    def append_row(self, values: Sequence[float]) -> None:
        """Take a row: time [s], then a value a channel in its SI unit."""


class RecordingSink(RowSink, Protocol):
    """Takes what is to be recorded: `RecorderProcess` and `InlineRecorder`."""

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""

    def start(self) -> None:
        """Open the files."""

    def stop(self) -> None:
        """Write what there is and close the files."""

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames at a time [ns] that we received, or else sent."""


class InlineRecorder:
    """A recorder in the caller's thread that writes a block each `BLOCK_PERIOD` of bench time.

    Args:
        plan: what to record.
    """

    def __init__(self, plan: RecordingPlan) -> None:
        plan.check()
        self._plan = plan
        self._row = struct.Struct(f"<{1 + len(plan.channels)}d")
        self._block_end = BLOCK_PERIOD

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""
        return self._recorder.report

    def start(self) -> None:
        """Open the files."""
        self._recorder = Recorder(self._plan, durable=False, tell=warn)

    def stop(self) -> None:
        """Write what there is and close the files."""
        self._recorder.close()

    def append_row(self, values: Sequence[float]) -> None:
        """Record a row: time [s], then a value a channel in its SI unit."""
        self._recorder.append_row(self._row.pack(*values))
        self._end_block(values[0])

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames at a time [ns] that we received, or else sent."""
        self._recorder.append_frames([LoggedFrame(frame, now, is_received) for frame in frames])
        self._end_block(now * 1e-9)

    def _end_block(self, time: float) -> None:
        if time >= self._block_end:
            self._block_end = time + BLOCK_PERIOD
            self._recorder.write_block()


# Records what passes a bus as a controller sees it.


class NetworkTap:
    """An observer of the drivers' `Network` that records its frames.

    Args:
        recording: what takes the frames; its time 0 is now.
        clock: the network's time [s].

    Attributes:
        origin: time 0 of the recording on that clock [s].
    """

    def __init__(self, recording: RecordingSink, clock: Callable[[], float]) -> None:
        self._recording = recording
        self._clock = clock
        self.origin = clock()

    def now(self) -> float:
        """Return the time on the recording's time base [s]."""
        return self._clock() - self.origin

    def observe(self, message: "can.Message") -> None:
        """Record a frame that the network received or sent."""
        frame = frame_of(message)
        if frame is None:
            return
        self._recording.append_frames([frame], round(self.now() * 1e9), is_received=message.is_rx)
