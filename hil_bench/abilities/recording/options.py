"""Arguments that ask for a recording, and what is said of it at the end."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bench.abilities.recording.formats import check_suffix
from hil_bench.abilities.recording.report import FileReport, RecordingReport, RecordingWish
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.session import Session
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from hil_bench.abilities.recording.recorder import RecordingSink

EXAMPLES = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --record run.mf4
  hil-bench run -i virtual -c bench --speed max --duration 60 --record frozen.mf4
                --fault freeze pressure_a at_s=10
"""
}


def add_options(parser: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add the arguments of a recording of a run."""
    add_recording_arguments(parser, often).add_argument(
        "--whole-bus",
        action="store_true",
        help="with --record: also record frames that the bench does not use; each costs the loop "
        "time (in lock-step all frames are recorded anyway)",
    )


def check_options(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant of a run.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    check_recording_arguments(args)
    if args.whole_bus and not args.record:
        raise ConfigError("--whole-bus: belongs to a recording; give --record FILE too")


def add_recording_arguments(
    parser: argparse.ArgumentParser, often: "argparse._ActionsContainer | None" = None
) -> "argparse._ActionsContainer":
    """Add the arguments of a recording, and return their group; --record to `often` if given."""
    group = parser.add_argument_group("recording")
    (often or group).add_argument(
        "--record",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="record while the bench runs; the suffix gives the format: .mf4 signals and frames, "
        ".csv signals, .blf .asc .log frames; repeat it for more files",
    )
    right = 'start recording when a signal passes a level, as in "axis1.P_A > 80 bar"'
    add_trigger_arguments(group, right)
    return group


def add_trigger_arguments(parser: "argparse._ActionsContainer", right: str) -> None:
    """Add --trigger, with its help, and --pre-trigger."""
    parser.add_argument("--trigger", default="", metavar="CONDITION", help=right)
    parser.add_argument(
        "--pre-trigger",
        type=float,
        default=1.0,
        metavar="S",
        help="also record S seconds before the trigger (default: 1)",
    )


def check_recording_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.trigger and not args.record:
        raise ConfigError("--trigger: begins a recording; give --record FILE too")
    check_pre_trigger(args)
    for path in args.record:
        check_suffix(path)
    if len(set(args.record)) < len(args.record):
        raise ConfigError(f"--record {args.record[-1]}: is there twice; give each file once")


def check_pre_trigger(args: argparse.Namespace) -> None:
    """Refuse a time before the trigger that cannot be meant.

    Raises:
        ConfigError: it is negative, or beyond an hour.
    """
    if not 0 <= args.pre_trigger <= 3600:
        raise ConfigError(f"--pre-trigger {args.pre_trigger:g}: give 0 to 3600 s")


def recording_wish(args: argparse.Namespace) -> RecordingWish:
    """Return the recordings that the command line asks for."""
    return RecordingWish(tuple(args.record), args.trigger, args.pre_trigger)


def recording_code(report: RecordingReport | None) -> ExitCode:
    """Return the exit code of a recording, None for one that was not asked for."""
    return ExitCode.DONE if report is None or report.is_complete else ExitCode.LOST


def report_lines(report: RecordingReport) -> list[str]:
    """Return a report of a recording, a line a fact."""
    lines = [line for file in report.files for line in _file_lines(file)]
    if not report.is_triggered:
        lines.append("nothing: its trigger never came")
    if report.lost:
        lines.append(f"{report.lost} messages left out, the recorder was too slow")
    return [f"{'' if number else 'recorded':8}  {line}" for number, line in enumerate(lines)]


def _file_lines(file: FileReport) -> list[str]:
    counts = [
        f"{count} {what}"
        for count, what in ((file.rows, "rows"), (file.frames, "frames"))
        if count is not None
    ]
    return [f"{', '.join(counts)}: {file.path}", *filter(None, [file.problem])]


# A recording beside a run.


class RunRecording:
    """The recording of a run.

    Args:
        sink: takes it; None where nobody asks for one.
        hears_all: whether it wants all frames of the bus.

    Attributes:
        hears_all: as passed in.
    """

    def __init__(self, sink: "RecordingSink | None", *, hears_all: bool) -> None:
        self.hears_all = hears_all
        self._sink = sink

    @property
    def code(self) -> ExitCode:
        """The exit code of a run with it: that of lost data where some are missing by now."""
        return recording_code(None if self._sink is None else self._sink.report)

    def lines(self) -> list[str]:
        """Return its content, a line a fact."""
        return [] if self._sink is None else report_lines(self._sink.report)

    def content(self) -> dict[str, object]:
        """Return its report; None where there is none."""
        if self._sink is None:
            return {"recording": None}
        report = self._sink.report
        return {"recording": asdict(report) | {"is_complete": report.is_complete}}


@contextmanager
def accompany(
    args: argparse.Namespace, session: Session, config: BenchConfig, *, is_real_time: bool
) -> Iterator[RunRecording]:
    """Record a run as its command line says.

    Args:
        args: the command line.
        session: not yet started.
        config: of the bench.
        is_real_time: whether ticks must not wait for a disk.

    Yields:
        The recording.
    """
    wish = recording_wish(args)
    if not wish.paths:
        yield RunRecording(None, hears_all=False)
        return
    from hil_bench.abilities.recording.sessions import recorded  # noqa: PLC0415 - brings much

    with recorded(session, wish, config, is_real_time=is_real_time) as sink:
        yield RunRecording(sink, hears_all=args.whole_bus)
