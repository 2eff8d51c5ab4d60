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
from hil_bench.cli.helpers import add_loss_argument
from hil_bench.cli.parser import add_options, check_options, take_over
from hil_bench.cli.results import add_json_argument
from hil_bench.cli.run_setup import HUB_CHANNEL
from hil_bench.errors import ConfigError
from hil_bench.outside.transports.transport import HUB_PORT

_EXAMPLES = f"""\
examples:
  hil-bench run -i socketcan -c vcan0
  hil-bench run bench.toml -i socketcan -c can0 -b 500000 --duration 60
  hil-bench run -i socketcan -c can0 --realtime fifo --realtime-cpu 3
  hil-bench run --hub                  a bus for other programs where there is no SocketCAN;
                                       they join it with: -i socketcand -c {HUB_CHANNEL}
                                       --bus-kwargs host=127.0.0.1 port={HUB_PORT}
  hil-bench run -i socketcan -c vcan0 --duration 60 --json > summary.json
                                       the summary for a program; all else on standard error
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "run",
        description="Run the bench on a CAN bus in real time, until Ctrl-C or --duration.",
        epilog=_EXAMPLES,
    )
    often = parser.add_argument_group("most used")
    add_bench_arguments(parser)
    _add_often(often)
    add_options("run", parser, often)
    add_json_argument(often)
    _add_timing(add_loop_arguments(parser))
    seldom = parser.add_argument_group("seldom used")
    _add_seldom(seldom)
    add_options("run seldom", parser, seldom)
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
        const=HUB_PORT,
        metavar="PORT",
        help=f"host a bus on 127.0.0.1 in the socketcand protocol (default port: {HUB_PORT})",
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


def run(args: argparse.Namespace) -> int:
    """Run the bench until somebody ends it, or its bus is lost."""
    check_arguments(args)
    check_options("run", args)
    code = take_over("run", args)
    if code is not None:
        return code
    from hil_bench.cli import paced_run  # noqa: PLC0415 - brings much

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
    if math.isinf(args.speed):
        refuse_timing(args, "at --speed max")
    if args.hub_unlimited and args.hub is None:
        raise ConfigError("--hub-unlimited: belongs to --hub; leave it out")
    if args.hub is not None and ("interface" in args or "channel" in args):
        raise ConfigError("--hub makes a bus of its own; give either --hub or -i and -c")


def refuse_timing(args: argparse.Namespace, when: str) -> None:
    """Refuse options of the clock.

    Args:
        args: the command line.
        when: the run has none.

    Raises:
        ConfigError: one is given.
    """
    for option in ("strict_timing", "histograms", "realtime", "overrun"):
        if getattr(args, option):
            flag = f"--{option.replace('_', '-')}"
            raise ConfigError(f"{flag}: {when} there is no real time to miss; leave it out")
