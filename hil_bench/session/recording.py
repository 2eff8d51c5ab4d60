"""Recording as an observer of a session, whatever makes its ticks."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.faults.faults import Faults
from hil_bench.outside.recording.inline_recorder import InlineRecorder, RecordingSink
from hil_bench.outside.recording.recorder import RecordingPlan
from hil_bench.outside.recording.recorder_process import RecorderProcess
from hil_bench.session.fault_ranges import ranges_of, write_faults
from hil_bench.session.session import Session
from hil_bench.session.telemetry import recording_heading


class RecordingWish(NamedTuple):
    """The files to record to, with trigger and pre-trigger time.

    Attributes:
        paths: the files; their suffixes are their formats, see docs/recording.md.
        trigger: what begins it, as in ``axis1.P_A > 80 bar``; empty for the start.
        pre_trigger: time before the trigger that is recorded too [s].
    """

    paths: tuple[Path | str, ...] = ()
    trigger: str = ""
    pre_trigger: float = 1.0


NO_RECORDING = RecordingWish()


@contextmanager
def recorded(
    session: Session, wish: RecordingWish, config: BenchConfig, *, is_real_time: bool
) -> Iterator[RecordingSink | None]:
    """Record a session from now until the end of the block.

    Args:
        session: not yet started.
        wish: what to record.
        config: of the bench.
        is_real_time: whether ticks must not wait for a disk, so that another process writes.

    Yields:
        What takes the recording; None where nothing is wished for.
    """
    if not wish.paths:
        yield None
        return
    sink = open_sink(session, wish, config, is_real_time=is_real_time)
    sink.start()
    observer = RecordingObserver(session, sink)
    try:
        yield sink
    finally:
        observer.leave()
        sink.stop()
        write_faults(sink.report, ranges_of(session.bench.part(Faults).events, session.now * 1e-9))


def open_sink(
    session: Session, wish: RecordingWish, config: BenchConfig, *, is_real_time: bool
) -> RecordingSink:
    """Return the sink for a recording of a session, not yet started; see `recorded`."""
    plan = RecordingPlan(
        tuple(map(Path, wish.paths)),
        session.channels,
        trigger=wish.trigger,
        pre_trigger=wish.pre_trigger,
        heading=recording_heading(config, is_real_time=is_real_time),
    )
    return RecorderProcess(plan) if is_real_time else InlineRecorder(plan)


class RecordingObserver:
    """Hands rows and frames of a session to what records them, from now on.

    Args:
        session: what is recorded.
        sink: has been started.
    """

    def __init__(self, session: Session, sink: RecordingSink) -> None:
        self._session = session
        self._sink = sink
        session.watch(frames=self._take, rows=sink.append_row)

    def leave(self) -> None:
        """Hand over nothing more; between two ticks only."""
        self._session.unwatch(frames=self._take, rows=self._sink.append_row)

    def _take(self, received: Sequence[Frame], sent: Sequence[Frame], now: int) -> None:
        self._sink.append_frames(received, now, is_received=True)
        self._sink.append_frames(sent, now, is_received=False)
