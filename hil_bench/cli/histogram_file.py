"""The timing of a run as a file for programs: summary and histograms in JSON."""

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Self

from hil_bench.errors import about_file, check_replaceable
from hil_bench.outside.realtime.statistics import DurationHistogram, TickSummary
from hil_bench.outside.recording.block_file import naming
from hil_bench.outside.transports.bus_load import load_of
from hil_bench.session.paced import RunReport


class HistogramFile:
    """A file that is opened before the run and written after it.

    Args:
        path: the file; None for none.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: IO[str] | None = None
        if path is None:
            return
        check_replaceable(path)
        with about_file(f"--histograms {path}", right="give a file in a directory of yours"):
            self._file = path.open("w", encoding="ascii")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # `write` has said so
                self._file.close()

    def write(self, report: RunReport, period_ns: int, bitrate: int) -> None:
        """Write what a run did."""
        if self._file is not None:
            with naming(Path(self._file.name)):
                json.dump(timing(report, period_ns, bitrate), self._file, indent=1)
                self._file.write("\n")
                self._file.close()


def timing(report: RunReport, period_ns: int, bitrate: int) -> dict[str, Any]:
    """Return the timing of a run: counts, and for each duration percentiles and bins."""
    ticks = report.ticks
    elapsed = (ticks.ticks + ticks.skipped) * period_ns
    statistics = report.statistics
    return figures(ticks, period_ns) | {
        "lateness": asdict(ticks.lateness) | {"bins": bins(statistics.lateness)},
        "work": asdict(ticks.work) | {"bins": bins(statistics.work)},
        "frames": asdict(report.frames),
        "bus_load": load_of(report.frames.bits, elapsed, bitrate),
        "bitrate": bitrate,
        "ended_by": None if report.lost is None else str(report.lost),
    }


def figures(ticks: TickSummary, period_ns: int) -> dict[str, Any]:
    """Return the figures of a loop: counts, and percentiles of each duration."""
    return {
        "tick_us": period_ns / 1000,
        "ticks": ticks.ticks,
        "overruns": ticks.overruns,
        "skipped": ticks.skipped,
        "lateness": asdict(ticks.lateness),
        "work": asdict(ticks.work),
    }


def bins(histogram: DurationHistogram) -> list[dict[str, float]]:
    """Return the bins that are not empty: largest value [us], and count."""
    return [{"to_us": edge, "count": count} for edge, count in histogram.bins()]
