"""The recording of a network, as of a machine under `hil-bench commission` and `hil-bench test`."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import can

from hil_bench import __version__
from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.abilities.recording.formats import Heading
from hil_bench.abilities.recording.recorder import (
    InlineRecorder,
    RecordingPlan,
    RecordingSink,
)
from hil_bench.abilities.recording.recorder_process import RecorderProcess
from hil_bench.abilities.recording.sessions import write_spans
from hil_bench.outside.messages import frame_of
from hil_bench.outside.recording.channels import Channel


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

    def observe(self, message: can.Message) -> None:
        """Record a frame that the network received or sent."""
        frame = frame_of(message)
        if frame is None:
            return
        self._recording.append_frames([frame], round(self.now() * 1e9), is_received=message.is_rx)


@contextlib.contextmanager
def recorded_work(
    path: Path, opened: OpenNetwork, channels: Sequence[Channel], what: str
) -> Iterator[tuple[RecordingSink, float]]:
    """Record samples and frames: by another process where time does not wait for us.

    Args:
        path: of the file.
        opened: the machine's network.
        channels: of the samples, after the time.
        what: is recorded, for the file's heading.

    Yields:
        What takes the samples, and its time 0 on the network's clock [s].
    """
    is_real_time = opened.virtual is None and not opened.is_stepped
    started = datetime.now(UTC) if is_real_time else None
    heading = Heading(f"hil-bench {__version__}, {what}", started)
    plan = RecordingPlan((path,), tuple(channels), heading=heading)
    recording = RecorderProcess(plan) if is_real_time else InlineRecorder(plan)
    recording.start()
    tap = NetworkTap(recording, opened.network.now)
    opened.network.observe = tap.observe
    try:
        yield recording, tap.origin
    finally:
        opened.network.observe = None
        recording.stop()
        write_spans(recording.report, [])
