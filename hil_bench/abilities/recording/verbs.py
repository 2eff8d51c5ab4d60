"""`hil-bench plot`: a recording as a picture."""

import argparse
from pathlib import Path

import numpy as np

from hil_bench.abilities.common.block_file import READ_LOGS
from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.recording.formats import FRAME_SUFFIXES
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.mdf_blocks import read_events
from hil_bench.abilities.recording.plot import has_axis, plot_frames, plot_result, plot_signals
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Recording, Span, recording_channels

_EXAMPLES = """\
examples:
  hil-bench plot run.mf4                                   run.png: motion, pressures, spool
  hil-bench plot run.mf4 --signals "axis1.P_*" -o p.svg    chosen signals
  hil-bench plot run.mf4 --frames                          the traffic on the bus
  hil-bench plot bus.log
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "plot",
        description="Draw a recording: the motion of its axes, chosen signals, or the traffic on\n"
        "the bus where it has no signals.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("recording", type=Path, metavar="FILE", help="the recording")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PICTURE",
        help="picture to write: .png, .svg or .pdf (default: FILE.png)",
    )
    parser.add_argument(
        "--signals",
        action="append",
        default=[],
        metavar="NAME",
        help='draw these signals, one panel per unit, as in "axis1.P_*"; repeat it for more',
    )
    parser.add_argument("--frames", action="store_true", help="draw the traffic on the bus")
    parser.add_argument(
        "--from", type=float, default=-np.inf, metavar="S", dest="begin", help="begin at S seconds"
    )
    parser.add_argument(
        "--to", type=float, default=np.inf, metavar="S", dest="end", help="end at S seconds"
    )
    add_json_argument(parser)
    add_units_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw the recording and print where.

    Raises:
        ConfigError: no time is between --from and --to, or nothing can be drawn.
    """
    if args.begin > args.end:
        raise ConfigError(f"--from {args.begin:g}: is after --to {args.end:g}")
    path = _beside(args.recording) if args.output is None else _picture(args.output)
    title = args.recording.name.encode(errors="backslashreplace").decode()
    is_traffic = False
    if args.frames or args.recording.suffix.lower() in READ_LOGS:
        _plot_frames(args, path, title)
    else:
        recording = read_recording(args.recording)
        is_traffic = not len(recording) and _has_frames(args)
        recording = recording if is_traffic else _cut(recording, args)
        if is_traffic:
            _plot_frames(args, path, title)
        elif has_axis(recording) and not args.signals:
            plot_result(recording, path, title=title, spans=_faults(recording, args.recording))
        elif len(recording_channels(recording)) > 1 or args.signals:
            spans = _faults(recording, args.recording)
            plot_signals(recording, path, patterns=args.signals, title=title, spans=spans)
        else:  # of a bench without an axis: time alone
            _plot_frames(args, path, title)
    lines = [_traffic_note(args.recording)] if is_traffic and not args.frames else []
    print_results(args, [*lines, str(path)], {"picture": path})
    return ExitCode.DONE


def _faults(recording: Recording, path: Path) -> list[Span]:
    """Return the faults that a recording carries, within the rows that are drawn."""
    if path.suffix.lower() != ".mf4" or not len(recording):
        return []
    first, last = float(recording[TIME.name][0]), float(recording[TIME.name][-1])
    return [
        Span(max(span.begin, first), min(span.end, last), span.label)
        for span in read_events(path)
        if span.end >= first and span.begin <= last
    ]


def _has_frames(args: argparse.Namespace) -> bool:
    """Return True if a recording without signals has frames.

    Raises:
        ConfigError: it has, and signals are asked for.
    """
    if args.recording.suffix.lower() not in FRAME_SUFFIXES:
        return False
    if next(read_frames(args.recording, errors=True), None) is None:
        return False
    if args.signals:
        raise ConfigError(_traffic_note(args.recording))
    return True


def _traffic_note(recording: Path) -> str:
    right = f"'hil-bench decode {recording} bench.toml -o decoded.mf4' makes signals of them"
    return f"{recording}: holds frames and no signals; {right}"


def _beside(recording: Path) -> Path:
    """Return the picture beside a recording.

    Raises:
        ConfigError: it is a directory without a name.
    """
    if not recording.name:
        raise ConfigError(f"{recording}: cannot be read: Is a directory; give a recording")
    return recording.with_suffix(".png")


def _picture(path: Path) -> Path:
    """Return a picture's file as it is written: without a suffix it is .png.

    Raises:
        ConfigError: it is a directory.
    """
    if path.is_dir():
        raise ConfigError(f"{path}: is a directory; give the name of a picture")
    return path if path.suffix else path.with_suffix(".png")


def _plot_frames(args: argparse.Namespace, path: Path, title: str) -> None:
    """Draw the traffic.

    Raises:
        ConfigError: signals are asked for too, or there are no frames.
    """
    if args.signals:
        raise ConfigError(f"--signals: {args.recording} is drawn as frames; give one or the other")
    frames = [
        logged
        for logged in read_frames(args.recording)
        if args.begin <= logged.now * 1e-9 <= args.end
    ]
    if not frames:
        raise ConfigError(f"{args.recording}: no frames to draw, at least not in this time")
    plot_frames(frames, path, title=title, name_of=_name_of)


def _name_of(can_id: int) -> str:
    """Return an identifier with its use in the predefined connection set of CiA 301."""
    name, node_id = function_of(can_id)
    whose = "" if node_id is None else f" node {node_id}"
    return f"{name}{whose}  0x{can_id:03X}"


def _cut(recording: Recording, args: argparse.Namespace) -> Recording:
    """Return the rows within --from and --to.

    Raises:
        ConfigError: there are none.
    """
    times = recording[TIME.name]
    rows: Recording = recording[(times >= args.begin) & (times <= args.end)]
    if not len(rows):
        reach = f"{times[0]:g} to {times[-1]:g} s" if len(times) else "no rows at all"
        raise ConfigError(f"{args.recording}: no rows to draw; it has {reach}")
    return rows
