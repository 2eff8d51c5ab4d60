"""`hil-bench replay`: recorded frames back on a bus, or recorded set-points into the plant."""

import argparse
import contextlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import can

from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.progress import (
    Work,
    shown_work,
)
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.recording.column_map import check_polarities, read_column_map, read_mapped
from hil_bench.abilities.recording.frames import LeftOut, message_of, read_frames
from hil_bench.abilities.recording.quantities import check_quantities, find_doubts, make_even
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.replay import drive as drives
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli import arguments
from hil_bench.cli.exit_codes import ExitCode, interruption
from hil_bench.cli.results import plain, warn_of
from hil_bench.errors import BusError, ConfigError, NothingSeenError, first_line
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.recording.channels import LoggedFrame, Recording
from hil_bench.outside.transports.opening import open_can_bus
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.units import quantity

_EXAMPLES = """\
examples:
  hil-bench replay run.mf4 -i socketcan -c vcan0                       all frames, as recorded
  hil-bench replay run.mf4 -i socketcan -c vcan0 --frames received     of a bench's recording:
                                                                       what its controller sent
  hil-bench replay run.csv --virtual bench.toml                        set-points into the plant
  hil-bench replay run.csv --virtual --tolerance "position=0.5 mm"
  hil-bench replay rig.csv --virtual bench.toml --columns rig.toml     of another logger
"""

_TOLERANCE = re.compile(r"\s*([^=\s]+)\s*=\s*(\S+?)\s*([A-Za-z%/]*)\s*")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "replay",
        description="Put the frames of a recording back on a bus with their timing; or, with\n"
        "--virtual, drive the plant of a bench with the recorded spool set-points and compare.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("recording", type=Path, metavar="FILE", help="the recording")
    arguments.add_bench_arguments(parser)
    parser.add_argument(
        "--frames",
        choices=[direction.value for direction in drives.FrameDirection],
        default=drives.FrameDirection.ALL.value,
        help="frames to replay, as the recorder saw them; a .log does not say (default: all)",
    )
    parser.add_argument(
        "--speed",
        type=arguments.read_speed,
        default=1.0,
        metavar="X",
        help="factor of the speed, as in 2, or max (default: 1)",
    )
    virtual = parser.add_argument_group("set-points into the plant")
    virtual.add_argument(
        "--virtual",
        action="store_true",
        help="use no bus: drive the plant of the bench with the recorded set-points, in virtual "
        "time, and compare; exit code 1 where a deviation is out of tolerance, 6 where none is and "
        "one was not seen throughout",
    )
    virtual.add_argument(
        "--tolerance",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help='largest deviation allowed, as in "position=0.5 mm" or "axis1.P_A=3 bar" '
        "(default: position 1 mm, pressures 2 bar, spool position 2 %%)",
    )
    common.add_column_arguments(virtual)
    virtual.add_argument("--axis", metavar="NAME", help="axis of --columns (default: the first)")
    virtual.add_argument("--json", action="store_true", help="print JSON for a program to read")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play the recording.

    Raises:
        ConfigError: --virtual and a bus, or columns without --virtual.
    """
    if args.virtual and ("interface" in args or "channel" in args):
        raise ConfigError("--virtual needs no bus; give either --virtual or -i and -c")
    if not args.virtual and (args.columns or args.map or args.axis):
        raise ConfigError("--columns, --map and --axis are for --virtual; give that, too")
    config = arguments.load_bench_config(args)
    return drive(args, config) if args.virtual else play(args, config)


def play(args: argparse.Namespace, config: BenchConfig) -> int:
    """Put the frames on the bus.

    Raises:
        ConfigError: none of them are meant, or the bus cannot carry them.
        NothingSeenError: there are none.
        BusError: the bus was lost.
    """
    direction = drives.FrameDirection(args.frames)
    left_out = LeftOut()
    found = list(read_frames(args.recording, left_out, buses=len(config.buses)))
    recorded = [logged for logged in found if not logged.frame.bus]
    left_out.channels.update(f"can{logged.frame.bus}" for logged in found if logged.frame.bus)
    warn_of([f"{args.recording}: {what}" for what in left_out.words()])
    if not recorded:
        raise NothingSeenError(f"{args.recording}: has no frames to play")
    if direction is not drives.FrameDirection.ALL and any(
        logged.is_received is None for logged in recorded
    ):
        raise ConfigError(
            f"{args.recording}: a candump log does not say which frames were {direction.value}; "
            "record .mf4, .blf or .asc, or leave --frames out"
        )
    frames = [logged for logged in recorded if direction.includes(logged)]
    if not frames:
        which = f"no {direction.value} frames to play; all its {len(recorded)} are others"
        raise ConfigError(f"{args.recording}: has {which}")
    count = 0 if config.bus.fd else sum(logged.frame.fd != 0 for logged in frames)
    if count:
        right = "give --fd, and a bus that carries it"
        raise ConfigError(f"{args.recording}: has {count} frames of CAN FD; {right}")
    with contextlib.ExitStack() as stack:
        wish = stack.enter_context(interruption())
        bus, what = open_can_bus(*config.bus.address)
        stack.enter_context(bus)
        work = stack.enter_context(shown_work(args, Work("replay", len(frames), "frames")))

        def send(logged: LoggedFrame) -> None:
            bus.send(message_of(logged))
            work.done += 1

        try:
            report = drives.play_frames(
                frames,
                send,
                MonotonicClock(),
                speed=args.speed,
                stopped=lambda: wish.requested,
            )
        except (can.CanError, OSError) as error:
            raise BusError(f"{what}: {first_line(error)}") from error
    if not args.quiet:
        print(
            f"{report.frames} of {len(frames)} frames on {what} in {report.duration:.1f} s, "
            f"at most {report.latest * 1e3:.1f} ms late"
        )
    return ExitCode.INTERRUPTED if wish.requested else ExitCode.DONE


def drive(args: argparse.Namespace, config: BenchConfig) -> int:
    """Drive the plant and compare.

    Raises:
        ConfigError: the recording lacks what is needed.
    """
    recorded = _read_signals(args, config)
    _check_units(args, config, recorded)
    units = {each.name: each.unit for axis in config.axes for each in drives.compared(axis)}
    tolerances = dict(_tolerance(text, units) for text in args.tolerance)
    try:
        with shown_work(args, Work("replay")):
            driven = drives.drive_plant(config, recorded)
    except ConfigError as error:
        raise ConfigError(f"{args.recording}: {error}") from None
    deviations = drives.compare_recordings(config, recorded, driven, tolerances)
    if args.json:
        print(json.dumps(plain(map(_content, deviations)), indent=2))
    elif not args.quiet:
        print("\n".join((_HEAD, *map(_line, deviations))))
    verdicts = {deviation.verdict for deviation in deviations}
    if drives.Verdict.FAILED in verdicts:
        return ExitCode.CHECK_FAILED
    is_decided = drives.Verdict.PASSED in verdicts and drives.Verdict.INCONCLUSIVE not in verdicts
    return ExitCode.DONE if is_decided else ExitCode.INCONCLUSIVE


def _content(deviation: drives.SignalDeviation) -> dict[str, object]:
    """Return a deviation for a program to read."""
    is_within = deviation.verdict in {drives.Verdict.PASSED, drives.Verdict.NOT_JUDGED}
    return {**asdict(deviation), "is_within": is_within, "verdict": deviation.verdict}


def _read_signals(args: argparse.Namespace, config: BenchConfig) -> Recording:
    """Return the recording, that of another logger with even rows.

    Raises:
        ConfigError: its columns say too little.
    """
    if not args.columns and not args.map:
        return read_recording(args.recording)
    axis = common.find_cylinder(config, args.axis, "replay --columns").name
    mapped = read_column_map(args.columns, args.map).of(args.recording.name)
    check_polarities(args.recording, mapped)
    recorded = read_mapped(args.recording, mapped, axis)
    try:
        recorded, notes = make_even(recorded, list(recorded.dtype.names or ())[1:])
    except ConfigError as error:
        raise ConfigError(f"{args.recording}: {error}") from None
    warn_of([f"{args.recording}: {note}" for note in notes])
    return recorded


def _check_units(args: argparse.Namespace, config: BenchConfig, recorded: Recording) -> None:
    """Refuse columns of cylinders in a unit of something else, and doubt those of a wrong size.

    Raises:
        ConfigError: there is such a unit.
    """
    cylinders = [axis for axis in config.axes if isinstance(axis, CylinderConfig)]
    own = tuple(f"{axis.name}." for axis in cylinders)
    names = [name for name in recorded.dtype.names or () if name.startswith(own)]
    strokes = {f"{axis.name}.position": 2.0 * axis.parameters.h for axis in cylinders}
    try:
        check_quantities(recorded, names)
    except ConfigError as error:
        raise ConfigError(f"{args.recording}: {error}") from None
    warn_of([f"{args.recording}: {doubt}" for doubt in find_doubts(recorded, names, strokes)])


_HEAD = f"{'signal':24} {'rms':>12} {'worst':>12} {'at':>10}   tolerance"


def _line(deviation: drives.SignalDeviation) -> str:
    unit = display_unit(deviation.unit)
    numbers = [
        f"{unit.from_si(value):.4g} {unit.symbol}" for value in (deviation.rms, deviation.maximum)
    ]
    verdict: str = deviation.verdict
    if deviation.tolerance is not None:
        shown = verdict.upper() if verdict == drives.Verdict.FAILED else verdict
        verdict = f"{unit.from_si(deviation.tolerance):g} {unit.symbol}: {shown}"
    if deviation.seen < deviation.duration:
        verdict += f"; seen {deviation.seen:.6g} of {deviation.duration:.6g} s"
    time = f"{deviation.time:.3f} s"
    return f"{deviation.channel:24} {numbers[0]:>12} {numbers[1]:>12} {time:>10}   {verdict}"


def _tolerance(text: str, units: Mapping[str, str]) -> tuple[str, float]:
    """Return the channel and the tolerance in its SI unit, by the units of what is compared.

    Raises:
        ConfigError: the text is none.
    """
    match = _TOLERANCE.fullmatch(text)
    right = '"position=0.5 mm" is the form'
    if match is None:
        raise ConfigError(f'--tolerance "{text}": {right}')
    name, value, symbol = match.groups()
    unit = units.get(name.rpartition(".")[2])
    if unit is None:
        raise ConfigError(f'--tolerance "{text}": {", ".join(units)} are compared')
    tolerance = quantity(text, value, symbol, unit)
    if not 0 <= tolerance < math.inf:
        raise ConfigError(f'--tolerance "{text}": {right}')
    return name, tolerance
