"""The options of `hil-bench run` for lock-step; nothing here imports what they need."""

import argparse

from hil_bench.cli.run import refuse_timing
from hil_bench.errors import ConfigError

EXAMPLES = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --lockstep --sync-period-us 2000 --record trace.log
"""
}


def add_options(parser: argparse.ArgumentParser, _: "argparse._ActionsContainer") -> None:
    """Add what concerns a bench that the controller's SYNC moves."""
    group = parser.add_argument_group(
        "lock-step", "with a controller, whose SYNC moves the bench by one period"
    )
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


def check_options(args: argparse.Namespace) -> None:
    """Refuse options of the clock, and of a hub that others need.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if not args.lockstep:
        return
    if args.speed != 1:
        raise ConfigError("--speed: in lock-step the controller's SYNC is the pace; leave it out")
    refuse_timing(args, "in lock-step")
    if args.hub_unlimited:
        raise ConfigError("--hub-unlimited: in lock-step nothing is limited; leave it out")


def take_over(args: argparse.Namespace) -> int | None:
    """Run the bench in lock-step where that is asked for."""
    if not args.lockstep:
        return None
    from hil_bench.abilities.lockstep import run  # noqa: PLC0415 - brings much

    return run.run(args)
