"""The arguments of `hil-bench check` for the devices on a bus."""

import argparse
from pathlib import Path

from hil_bench.abilities.common.arguments import add_network_arguments
from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import ConfigError


def add_options(parser: argparse.ArgumentParser, _: "argparse._ActionsContainer") -> None:
    """Add the arguments of the check of a bus."""
    group = parser.add_argument_group("devices on a bus")
    group.add_argument(
        "--bus",
        action="store_true",
        help="compare the devices on the bus with the bench: presence, identity, PDO parameters "
        "and mapping, heartbeat, units, scaling; reads only",
    )
    add_network_arguments(group)
    group.add_argument(
        "--apply",
        action="store_true",
        help="show what would be written to mend the differences, ask, then write it; the nodes "
        "are left in PRE-OPERATIONAL",
    )
    group.add_argument("--node", type=int, metavar="N", help="--apply to this node only")
    group.add_argument("--yes", action="store_true", help="--apply without asking")
    group.add_argument(
        "--store", action="store_true", help="--apply, and have the nodes keep it (0x1010.01)"
    )
    group.add_argument(
        "--dcf",
        type=Path,
        metavar="DIR",
        help="write what would be applied as concise DCF (CiA 302-3), a file a node, into DIR",
    )


def take_over(args: argparse.Namespace, config: BenchConfig) -> int | None:
    """Check a bus where the command line asks for it.

    Raises:
        ConfigError: an option asks for what --bus does, without it.
    """
    for option in ("apply", "node", "yes", "store", "dcf", "virtual", "on"):
        if getattr(args, option) and not args.bus:
            raise ConfigError(f"--{option}: belongs to --bus; give both")
    for option in ("node", "yes", "store"):
        if getattr(args, option) and not args.apply:
            raise ConfigError(f"--{option}: belongs to --apply; give both")
    if not args.bus:
        return None
    from hil_bench.abilities.commissioning.verbs.bus_check import check_bus  # noqa: PLC0415 - talks to devices

    return check_bus(args, config)
