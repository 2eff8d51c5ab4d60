"""Arguments that ask for a recording, and what is said of it at the end."""

import argparse
from pathlib import Path

from hil_bench.abilities.recording.inline_recorder import RecordingSink
from hil_bench.abilities.recording.report import FileReport, RecordingReport
from hil_bench.abilities.recording.sessions import RecordingWish
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.formats import check_suffix


def add_recording_arguments(
    parser: argparse.ArgumentParser, often: "argparse._ActionsContainer | None" = None
) -> None:
    """Add the arguments of a recording, --record to the group `often` where there is one."""
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


def recording_lines(recording: RecordingSink | None) -> list[str]:
    """Return the content of a recording that has ended, a line a fact."""
    return [] if recording is None else report_lines(recording.report)


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
