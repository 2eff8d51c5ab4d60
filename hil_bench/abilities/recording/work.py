"""The recording of what a machine does under `hil-bench commission` and `hil-bench test`."""

import contextlib
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from hil_bench import __version__
from hil_bench.abilities.recording.inline_recorder import InlineRecorder, NetworkTap, RecordingSink
from hil_bench.abilities.recording.recorder import RecordingPlan
from hil_bench.abilities.recording.recorder_process import RecorderProcess
from hil_bench.cli.controller_side import OpenNetwork
from hil_bench.outside.recording.channels import Channel
from hil_bench.outside.recording.formats import Heading


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
