"""`hil-bench run`: the bench alone, on a bus that a controller joins."""

import argparse
import math
from pathlib import Path

from hil_bench.cli.arguments import (
    add_bench_arguments,
    add_loop_arguments,
    read_speed,
)
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.feed_side import add_feed_arguments, check_feed_arguments
from hil_bench.cli.helpers import add_loss_argument
from hil_bench.cli.parser import add_units_argument
from hil_bench.cli.recording_arguments import add_recording_arguments, check_recording_arguments
from hil_bench.cli.results import add_json_argument
from hil_bench.cli.run_setup import HUB_CHANNEL
from hil_bench.cli.verbs import add_options, take_over
from hil_bench.errors import ConfigError
from hil_bench.outside.transports.socketcand_hub import DEFAULT_PORT

_EXAMPLES = f"""\
examples:
  hil-bench run -i socketcan -c vcan0
  hil-bench run bench.toml -i socketcan -c can0 -b 500000 --duration 60
  hil-bench run -i socketcan -c can0 --realtime fifo --realtime-cpu 3
  hil-bench run -i socketcan -c vcan0 --record run.mf4
  hil-bench run -i socketcan -c vcan0 --panel
                                       with a web page to watch and break it
  hil-bench run -i socketcan -c vcan0 --modbus
                                       the sensors on Modbus TCP too, on port 5020
  hil-bench run -i socketcan -c vcan0 --fault freeze pressure_a at_s=10 for_s=2
  hil-bench run --hub                  a bus for other programs where there is no SocketCAN;
                                       they join it with: -i socketcand -c {HUB_CHANNEL}
                                       --bus-kwargs host=127.0.0.1 port={DEFAULT_PORT}
  hil-bench run -i virtual -c bench --speed max --duration 60 --record frozen.mf4
                --fault freeze pressure_a at_s=10
  hil-bench run -i socketcan -c vcan0 --duration 60 --json > summary.json
                                       the summary for a program; all else on standard error
  hil-bench run -i socketcan -c vcan0 --lockstep --sync-period-us 2000 --record trace.log
  hil-bench run --scenario examples/scenarios/settling.scenario.toml
                                       in real time, for people who watch; then the verdicts
  hil-bench run --scenario sag.scenario.toml -i socketcan -c can0
                                       the same, driven by the controller on the bus
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "run",
        description="Run the bench on a CAN bus, until Ctrl-C or --duration: in real time, or in\n"
        "lock-step with a controller, whose SYNC moves the bench by one period.",
        epilog=_EXAMPLES,
    )
    often = parser.add_argument_group("most used")
    add_bench_arguments(parser)
    _add_often(often)
    add_recording_arguments(parser, often)
    add_options("run", often)
    add_feed_arguments(parser, often)
    add_json_argument(often)
    add_lockstep_arguments(parser)
    _add_timing(add_loop_arguments(parser))
    seldom = parser.add_argument_group("seldom used")
    _add_seldom(seldom)
    add_units_argument(seldom)
    parser.set_defaults(run=run)


def _add_often(group: "argparse._ActionsContainer") -> None:
    group.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="end after S seconds of bench time (default: run until Ctrl-C)",
    )
    group.add_argument(
        "--speed",
        type=read_speed,
        default=1.0,
        metavar="X",
        help="factor of real time, as in 0.1, or max: as fast as this machine can (default: 1)",
    )
    group.add_argument(
        "--hub",
        nargs="?",
        type=int,
        const=DEFAULT_PORT,
        metavar="PORT",
        help=f"host a bus on 127.0.0.1 in the socketcand protocol (default port: {DEFAULT_PORT})",
    )
    group.add_argument(
        "--modbus",
        action="store_true",
        help="serve the devices on Modbus also if bench.toml has no [modbus]",
    )


def _add_timing(group: "argparse._ActionsContainer") -> None:
    group.add_argument(
        "--strict-timing",
        action="store_true",
        help=f"end with exit code {ExitCode.TIMING} if a tick overran",
    )
    group.add_argument(
        "--histograms",
        type=Path,
        metavar="FILE",
        help="write the timing of the run as JSON, with the histograms of lateness and work",
    )


def _add_seldom(group: "argparse._ActionsContainer") -> None:
    add_loss_argument(group)
    group.add_argument(
        "--hub-unlimited",
        action="store_true",
        help="with --hub: accept frames faster than the bit rate (-b, else 1 Mbit/s) carries "
        "them; without it, a program has to wait",
    )
    group.add_argument(
        "--whole-bus",
        action="store_true",
        help="with --record: also record frames that the bench does not use; each costs the loop "
        "time (in lock-step all frames are recorded anyway)",
    )


def add_lockstep_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns a bench that the controller's SYNC moves."""
    group = parser.add_argument_group("lock-step")
    group.add_argument(
        "--lockstep",
        action="store_true",
        help="let bench time pass only with the controller's SYNC (0x080), as fast as both can",
    )
    group.add_argument(
        "--sync-period-us",
        type=int,
        metavar="US",
        help="period of a SYNC in us (default: bench.sync_period_us, else one tick)",
    )


def run(args: argparse.Namespace) -> int:
    """Run the bench until it is told to stop, or its bus is lost."""
    check_arguments(args)
    code = take_over("run", args)
    if code is not None:
        return code
    # Each brings much that the other does not need.
    if args.lockstep:
        from hil_bench.abilities.lockstep import run as lockstep_run  # noqa: PLC0415

        return lockstep_run.run(args)
    from hil_bench.cli import paced_run  # noqa: PLC0415

    return paced_run.run(args)


def check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.duration is not None and not 0 < args.duration < float("inf"):
        raise ConfigError(f"--duration {args.duration:g}: give a positive number of seconds")
    if args.hub is not None and not 0 <= args.hub <= 65535:
        raise ConfigError(f"--hub {args.hub}: give a port from 1 to 65535, or 0 for a free one")
    if args.lockstep and args.speed != 1:
        raise ConfigError("--speed: in lock-step the controller's SYNC is the pace; leave it out")
    for option in ("strict_timing", "histograms", "realtime", "overrun"):
        if (args.lockstep or math.isinf(args.speed)) and getattr(args, option):
            flag, where = f"--{option.replace('_', '-')}", "in lock-step"
            where = where if args.lockstep else "at --speed max"
            raise ConfigError(f"{flag}: {where} there is no real time to miss; leave it out")
    check_recording_arguments(args)
    check_feed_arguments(args)
    if args.whole_bus and not args.record:
        raise ConfigError("--whole-bus: belongs to a recording; give --record FILE too")
    if args.hub_unlimited and (args.hub is None or args.lockstep):
        why = "in lock-step nothing is limited" if args.lockstep else "belongs to --hub"
        raise ConfigError(f"--hub-unlimited: {why}; leave it out")
    if args.hub is not None and ("interface" in args or "channel" in args):
        raise ConfigError("--hub makes a bus of its own; give either --hub or -i and -c")
