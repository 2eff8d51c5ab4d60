"""Recording as an observer of a session: of a whole run, and of what somebody begins and ends."""

import logging
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import hil_bench
from hil_bench.abilities.recording.formats import Heading
from hil_bench.abilities.recording.recorder import InlineRecorder, RecordingPlan, RecordingSink
from hil_bench.abilities.recording.recorder_process import RecorderProcess
from hil_bench.abilities.recording.report import RecordingReport, RecordingWish
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.events import event_spans
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, ControllerError
from hil_bench.outside.recording.channels import Span

logger = logging.getLogger(__name__)


def write_spans(report: RecordingReport, ranges: list[Span]) -> None:
    """Append all named times to the MF4 files of an ended recording; a problem is a line."""
    from hil_bench.abilities.recording.mdf_blocks import (  # noqa: PLC0415 - takes NumPy with it
        append_events,
    )

    for file in report.files:
        if file.path.suffix.lower() != ".mf4" or file.problem:
            continue
        try:
            append_events(file.path, ranges)
        except OSError as error:
            logger.warning("%s: its events are not in it: %s", file.path, error.strerror or error)


# Recording as an observer of a session, whatever makes its ticks.


@contextmanager
def recorded(
    session: Session, wish: RecordingWish | Path | str, config: BenchConfig, *, is_real_time: bool
) -> Iterator[RecordingSink | None]:
    """Record a session from now until the end of the block.

    Args:
        session: not yet started.
        wish: what to record, or into which file.
        config: of the bench.
        is_real_time: whether ticks must not wait for a disk, so that another process writes.

    Yields:
        What takes the recording; None where nothing is wished for.
    """
    if isinstance(wish, (str, Path)):
        wish = RecordingWish((wish,))
    if not wish.paths:
        yield None
        return
    sink = open_sink(session, wish, config, is_real_time=is_real_time)
    sink.start()

    def finish() -> None:
        sink.stop()
        write_spans(sink.report, event_spans(session.bench, session.now * 1e-9))

    observer = RecordingObserver(session, sink)
    session.farewells.append(finish)
    try:
        yield sink
    finally:
        session.farewells.remove(finish)
        observer.leave()
        finish()


def open_sink(
    session: Session, wish: RecordingWish, config: BenchConfig, *, is_real_time: bool
) -> RecordingSink:
    """Return the sink for a recording of a session, not yet started; see `recorded`."""
    plan = RecordingPlan(
        tuple(map(Path, wish.paths)),
        session.channels,
        trigger=wish.trigger,
        pre_trigger=wish.pre_trigger,
        heading=_heading(config, is_real_time=is_real_time),
    )
    return RecorderProcess(plan) if is_real_time else InlineRecorder(plan)


def _heading(config: BenchConfig, *, is_real_time: bool) -> Heading:
    """Return the heading of a recording: version, bench file, seed and start time."""
    comment = (
        f"hil-bench {hil_bench.__version__}, {config.path or 'built-in bench'}, seed {config.seed}"
    )
    return Heading(comment, datetime.now(UTC) if is_real_time else None)


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


# A recording that somebody begins and ends while the bench runs, through its door.


class LiveRecording:
    """Records a session on request, one file at a time.

    Another thread opens the file and closes it, so that no tick waits for a disk.

    It is a part of the feed.

    Args:
        session: what is recorded.
        config: of the bench.
        is_real_time: whether ticks must not wait for a disk.

    Attributes:
        actions: what is asked for, by name.
    """

    def __init__(self, session: Session, config: BenchConfig, *, is_real_time: bool) -> None:
        self.actions = {
            "start_recording": lambda fields: self.start(Path(fields["path"])),
            "stop_recording": lambda _: self.stop(),
        }
        self._session = session
        self._config = config
        self._is_real_time = is_real_time
        self._path: Path | None = None
        self._begins = 0
        self._sink: RecordingSink | None = None
        self._observer: RecordingObserver | None = None
        self._job: _Job | None = None

    def state(self) -> dict[str, object]:
        """File and beginning [s] of the recording that runs; None without one."""
        return {"recording": self._running()}

    def _running(self) -> dict[str, object] | None:
        if self._observer is None:
            return None
        return {"path": str(self._path), "begins": self._begins * 1e-9}

    def start(self, path: Path) -> "Future[Any]":
        """Begin to record into a file.

        Args:
            path: absolute; its suffix is its format, see docs/recording.md.

        Returns:
            What gets its path and begin [s] once rows are recorded.

        Raises:
            ConfigError: a recording runs already, or the path cannot be one.
        """
        if self._path is not None:
            raise ConfigError(f"record: {self._path} is being recorded; stop that first")
        if not path.is_absolute():
            raise ConfigError(f"record: {path}: give an absolute path")
        sink = self._sink = open_sink(
            self._session, RecordingWish((path,)), self._config, is_real_time=self._is_real_time
        )
        self._path = path
        return self._begin(sink.start, self._started)

    def stop(self) -> "Future[Any]":
        """End the recording.

        Returns:
            What gets the content of the file: path, rows, frames, end [s], problem, lost.

        Raises:
            ConfigError: none runs.
        """
        if self._sink is None or self._observer is None:
            raise ConfigError("record: no recording runs that ctl, the page or attach() has begun")
        self._observer.leave()
        self._observer = None
        sink, now = self._sink, self._session.now * 1e-9
        begins = self._begins * 1e-9
        spans = event_spans(self._session.bench, now)

        def finish() -> None:
            sink.stop()
            write_spans(sink.report, [each for each in spans if each.end >= begins])

        return self._begin(finish, self._stopped)

    def look(self) -> None:
        """Go on where a file has been opened or closed; to be called between two ticks."""
        if self._job is None or self._job.is_alive():
            return
        job, self._job = self._job, None
        if job.problem is not None:
            self._path = self._sink = None
            job.answer.set_exception(job.problem)
        else:
            job.answer.set_result(job.then())

    def close(self) -> None:
        """End what runs, at the end of the bench, and wait until its file is closed."""
        while self._job is not None or self._observer is not None:
            if self._job is None:
                self.stop()
            else:
                self._job.join()
                self.look()

    def _begin(self, work: Callable[[], None], then: Callable[[], Any]) -> "Future[Any]":
        self._job = _Job(work, then)
        self._job.start()
        return self._job.answer

    def _started(self) -> Mapping[str, object] | None:
        if self._sink is not None:
            self._begins = self._session.now
            self._observer = RecordingObserver(self._session, self._sink)
        return self._running()

    def _stopped(self) -> Mapping[str, object]:
        path, sink, self._path, self._sink = self._path, self._sink, None, None
        if sink is None:
            return {}
        report = sink.report
        return {**asdict(report.files[0]), "path": str(path), "lost": report.lost}


class _Job(threading.Thread):
    """Work that may take a while, beside the bench.

    Args:
        work: what is to be done.
        then: returns the answer, in the thread of the bench.

    Attributes:
        answer: gets it.
        then: as passed in.
        problem: why it could not be done.
    """

    def __init__(self, work: Callable[[], None], then: Callable[[], Any]) -> None:
        super().__init__(daemon=True)
        self.answer: Future[Any] = Future()
        self.then = then
        self.problem: Exception | None = None
        self._work = work

    def run(self) -> None:
        try:
            self._work()
        except ConfigError as error:
            self.problem = error
        except Exception as error:  # whatever it is, the bench goes on
            self.problem = ControllerError(f"record: {type(error).__name__}: {error}")
