"""`hil-bench shadow`: the plant beside the machine, on the commands that the real valve gets."""

import argparse
import contextlib
import logging
import math
import time
from collections.abc import Generator
from pathlib import Path
from typing import NamedTuple

import can

from hil_bench.abilities.common.arguments import check_one_bus
from hil_bench.abilities.common.block_file import RecordingFile
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.common.stamps import SteadyStamps
from hil_bench.abilities.common.work import add_work_arguments, watched_work
from hil_bench.abilities.recording.frames import LeftOut, message_of, read_frames
from hil_bench.abilities.shadow.report import ShadowReport
from hil_bench.abilities.shadow.twin import Shadow, fit_limits
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import Ending, ExitCode, interruption
from hil_bench.cli.results import add_json_argument, warn_of
from hil_bench.errors import BusError, ConfigError, first_line
from hil_bench.outside.transports.opening import open_can_bus
from hil_bench.plants.hydraulic_cylinder.quantities import PORTS
from hil_bench.units import BAR, MILLIMETRE, PERCENT, Unit

logger = logging.getLogger(__name__)

Source = Generator[tuple[can.Message | None, float]]
"""Frames with the time since the start [s]."""

_POLL = 0.2  # how long a wait for frames may take [s], so that Ctrl-C is heard

_EXAMPLES = f"""\
examples:
  hil-bench shadow bench.toml -i socketcan -c can0
  hil-bench shadow bench.toml -i socketcan -c can0 --pressure-bar 5 --record residuals.csv
  hil-bench shadow bench.toml -i socketcan -c can0 --panel     machine and twin on a web page
  hil-bench shadow bench.toml --log run.blf          the frames of a recording, as fast as it goes

exit code {ExitCode.DONE:d} where the machine follows its twin, {ExitCode.CHECK_FAILED:d} where it \
differs, {ExitCode.INCONCLUSIVE:d} where nothing could be compared, or something \
only for a part of the time
"""


class _Limit(NamedTuple):
    """A limit that the command line may give.

    Attributes:
        flag: its option.
        quantities: what it limits.
        unit: of the option.
        text: for the help.
    """

    flag: str
    quantities: tuple[str, ...]
    unit: Unit
    text: str


_LIMITS = (
    _Limit("--position-mm", ("position",), MILLIMETRE, "position (default: 0.5 mm"),
    _Limit("--pressure-bar", PORTS, BAR, "pressures (default: 0.25 bar"),
    _Limit("--spool-percent", ("spool_position",), PERCENT, "spool (default: 3 %%"),
)


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "shadow",
        description="Run the plant of a bench on the commands that a real valve gets, as heard on\n"
        "the bus, and show how the machine differs from it. It joins at any moment: while the\n"
        "axis moves, stands, or has a fault. Nothing is sent.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="use no bus, but the frames of a recording"
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=math.inf,
        metavar="S",
        help="listen for S seconds (default: until Ctrl-C)",
    )
    parser.add_argument(
        "--horizon",
        type=float,
        default=0.5,
        metavar="S",
        help="set the plant to the sensors' values each S seconds (default: 0.5), and predict "
        "from there",
    )
    for limit in _LIMITS:
        noise = "" if limit.unit is PERCENT else "; more where [nodes.NAME.chain] has noise"
        parser.add_argument(
            limit.flag,
            type=float,
            metavar="X",
            help=f"highest RMS of a window of the {limit.text}{noise})",
        )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE.csv",
        help="write each measured value beside the twin's",
    )
    add_json_argument(parser)
    add_units_argument(parser)
    add_work_arguments(parser, "shadow")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Follow a machine, or a recording of one.

    Raises:
        ConfigError: both a recording and a bus are given.
    """
    _check_arguments(args)
    config = load_bench_config(args)
    check_one_bus(config, "shadow")
    if args.log is not None and ("interface" in args or "channel" in args):
        raise ConfigError("--log needs no bus; give either --log or -i and -c")
    shadow = Shadow(config, horizon=args.horizon)
    _check_sensors(config, shadow)
    report = ShadowReport(
        shadow,
        _limits(args, config),
        is_quiet=args.quiet or args.json,
        keeps=args.record is not None,
    )
    ending = Ending(args)
    file = None if args.record is None else RecordingFile(args.record)
    try:
        duration = 0.0
        title = f"{args.config or 'built-in bench'}, {args.log or config.bus.channel}"
        with (
            watched_work(args, "shadow", title, report.channels) as report.view,
            contextlib.closing(_log(args.log) if args.log else _bus(config)) as source,
        ):
            for message, duration in source:
                if message is not None:
                    shadow.take(message)
                report.take(duration)
                if duration >= args.duration:
                    break
            shadow.finish()
            report.take(duration)
            report.view.show(verdict=report.verdict[0])
        ending.take(report.verdict[1])
        if file is not None:
            with ending.going_on():
                file.write(report.recording())
    finally:
        if file is not None:
            file.close()
    with ending.going_on():
        report.finish(duration, as_json=args.json)
    return ending.code


def _check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    for name in ("duration", "horizon", "position_mm", "pressure_bar", "spool_percent"):
        value = getattr(args, name)
        if value is not None and not value > 0.0:
            raise ConfigError(f"--{name.replace('_', '-')} {value:g}: give more than 0")
    if not 0.02 <= args.horizon <= 60.0:
        raise ConfigError(f"--horizon {args.horizon:g}: give 0.02 to 60 s")
    if args.record is not None and args.record.suffix.lower() != ".csv":
        raise ConfigError(f"--record {args.record}: give a file name that ends in .csv")


def _check_sensors(config: BenchConfig, shadow: Shadow) -> None:
    """Say which axes cannot be compared.

    Raises:
        ConfigError: no axis can.
    """
    if not shadow.others:
        return
    axes = ", ".join(shadow.others)
    text = (
        f"{config.path}: no node reports position, P_A and P_B of {axes} on the bus; "
        "give it an encoder_406 and a pressure_404 at each port"
    )
    if not shadow.axes:
        raise ConfigError(text)
    logger.warning("%s", text)


def _limits(args: argparse.Namespace, config: BenchConfig) -> dict[str, dict[str, float]]:
    """Return the limits that fit the bench's sensors, but for those of the command line."""
    limits = fit_limits(config)
    for limit in _LIMITS:
        given = getattr(args, limit.flag[2:].replace("-", "_"))
        if given is not None:
            for of_axis in limits.values():
                of_axis.update(dict.fromkeys(limit.quantities, limit.unit.to_si(given)))
    return limits


def _log(path: Path) -> Source:
    """Read the frames of a recording.

    Yields:
        Each frame with its time from the first one [s].
    """
    first: float | None = None
    left_out = LeftOut()
    for logged in read_frames(path, left_out, buses=1):
        message = message_of(logged)
        first = message.timestamp if first is None else first
        yield message, message.timestamp - first
    warn_of([f"{path}: {what}" for what in left_out.words()])


def _bus(config: BenchConfig) -> Source:
    """Listen to the bus until Ctrl-C.

    Yields:
        Each frame with the time since the start [s]; None for a frame if none has come for a while.

    Raises:
        BusError: the bus is lost.
    """
    bus, what = open_can_bus(*config.bus.address)
    with bus, interruption() as interrupted:
        start, stamps = time.monotonic(), SteadyStamps()
        while not interrupted.requested:
            try:
                message = bus.recv(_POLL)
            except (can.CanError, OSError) as error:
                raise BusError(f"{what}: {first_line(error)}") from error
            yield message and stamps.straighten(message), time.monotonic() - start
