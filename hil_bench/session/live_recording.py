"""A recording that somebody begins and ends while the bench runs, through its door."""

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hil_bench.devices.faults.faults import Faults
from hil_bench.errors import ConfigError, ControllerError
from hil_bench.outside.recording.inline_recorder import RecordingSink
from hil_bench.session.fault_ranges import ranges_of, write_faults
from hil_bench.session.recording import RecordingObserver
from hil_bench.session.session import Session

OpenSink = Callable[[Path], RecordingSink]
"""Returns what will record into a file; it is not started yet."""


class LiveRecording:
    """Records a session on request, one file at a time.

    Another thread opens the file and closes it, so that no tick waits for a disk.

    Args:
        session: what is recorded.
        open_sink: returns what records into a file.
    """

    def __init__(self, session: Session, open_sink: OpenSink) -> None:
        self._session = session
        self._open_sink = open_sink
        self._path: Path | None = None
        self._begins = 0
        self._sink: RecordingSink | None = None
        self._observer: RecordingObserver | None = None
        self._job: _Job | None = None

    @property
    def state(self) -> dict[str, object] | None:
        """File and beginning [s] of the recording that runs; None without one."""
        if self._observer is None:
            return None
        return {"path": str(self._path), "begins": self._begins * 1e-9}

    def start(self, path: Path) -> "Future[Any]":
        """Begin to record into a file.

        Args:
            path: absolute; its suffix is its format, see docs/recording.md.

        Returns:
            What gets the `state` once rows are recorded.

        Raises:
            ConfigError: a recording runs already, or the path cannot be one.
        """
        if self._path is not None:
            raise ConfigError(f"record: {self._path} is being recorded; stop that first")
        if not path.is_absolute():
            raise ConfigError(f"record: {path}: give an absolute path")
        sink = self._sink = self._open_sink(path)
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
            raise ConfigError("record: no recording runs that was begun through the door")
        self._observer.leave()
        self._observer = None
        sink, now = self._sink, self._session.now * 1e-9
        begins = self._begins * 1e-9
        faults = ranges_of(self._session.bench.part(Faults).events, now)

        def finish() -> None:
            sink.stop()
            write_faults(sink.report, [each for each in faults if each.end >= begins])

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
        return self.state

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
