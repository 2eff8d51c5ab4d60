"""The wish for a recording, and its counts: shared by two processes, they outlive a recorder."""

import ctypes
import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.recording.formats import FRAME_SUFFIXES, SIGNAL_SUFFIXES

_ROWS, _ROWS_END, _FRAMES, _FRAMES_END = range(4)
_FIELDS = 4
_NS_PER_S = 1_000_000_000


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


@dataclass(frozen=True, slots=True)
class FileReport:
    """The content of one file of a recording, counted.

    Attributes:
        path: the file.
        rows: rows of signals; None where the format has no place for them.
        frames: frames; None where the format has no place for them.
        end: time of the last of them [s].
        problem: why it was given up; empty where it was not.
    """

    path: Path
    rows: int | None
    frames: int | None
    end: float
    problem: str


@dataclass(slots=True)
class RecordingReport:
    """The content of a recording, counted.

    Attributes:
        files: each file.
        is_triggered: whether its trigger came.
        lost: messages that the recorder was too slow for.
    """

    files: tuple[FileReport, ...]
    is_triggered: bool
    lost: int

    @property
    def rows(self) -> int:
        """Rows of signals in the file with the most."""
        return max(file.rows or 0 for file in self.files)

    @property
    def frames(self) -> int:
        """Frames in the file with the most."""
        return max(file.frames or 0 for file in self.files)

    @property
    def problems(self) -> list[str]:
        """Why files were given up, a line each."""
        return [file.problem for file in self.files if file.problem]

    @property
    def is_complete(self) -> bool:
        """Return True if all is there that was to be recorded."""
        return not (self.lost or self.problems)


class Counted(NamedTuple):
    """Rows or frames of a block.

    Attributes:
        amount: how many.
        end: time of the last [ns].
    """

    amount: int
    end: int


class Progress:
    """Counts what each file holds; hand it to the recorder as an argument of its `Process`.

    Args:
        paths: the files.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._counts = multiprocessing.RawArray(ctypes.c_int64, _FIELDS * len(paths) + 1)

    def count(self, number: int, rows: Counted, frames: Counted) -> None:
        """Count a block that is in a file, as far as the file has a place for it.

        Args:
            number: of the file.
            rows: its rows of signals.
            frames: its frames.
        """
        first, suffix = _FIELDS * number, self._paths[number].suffix.lower()
        for field, counted, suffixes in (
            (_ROWS, rows, SIGNAL_SUFFIXES),
            (_FRAMES, frames, FRAME_SUFFIXES),
        ):
            if counted.amount and suffix in suffixes:
                self._counts[first + field] += counted.amount
                self._counts[first + field + 1] = counted.end

    def trigger(self) -> None:
        """Take note that the trigger came, or that there is none."""
        self._counts[-1] = 1

    def end(self, number: int) -> float:
        """Return the time up to which a file holds all [s]."""
        first = _FIELDS * number
        ends = self._counts[first + _ROWS_END], self._counts[first + _FRAMES_END]
        return max(ends) / _NS_PER_S

    def report(self, problems: dict[int, str], lost: int = 0) -> RecordingReport:
        """Return the report on the files as they are now.

        Args:
            problems: why files were given up, by their numbers.
            lost: messages that the recorder was too slow for.
        """
        files = tuple(
            self._report_of(number, path, problems.get(number, ""))
            for number, path in enumerate(self._paths)
        )
        return RecordingReport(files, is_triggered=bool(self._counts[-1]), lost=lost)

    def _report_of(self, number: int, path: Path, problem: str) -> FileReport:
        suffix, first = path.suffix.lower(), _FIELDS * number
        return FileReport(
            path,
            self._counts[first + _ROWS] if suffix in SIGNAL_SUFFIXES else None,
            self._counts[first + _FRAMES] if suffix in FRAME_SUFFIXES else None,
            self.end(number),
            problem,
        )
