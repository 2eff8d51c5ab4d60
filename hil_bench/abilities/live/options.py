"""The options of `hil-bench run` for those who watch."""

import argparse
import importlib.util

from hil_bench.abilities.live.places import HAS_SOCKETS
from hil_bench.errors import ConfigError

NAME = "bench"
"""Name of a bench without `--name`."""

EXAMPLES = {
    "run": """\
  hil-bench run -i socketcan -c vcan0 --panel
                                       with a web page to watch and break it
"""
}


def add_options(parser: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add what concerns those who watch the bench, --panel to the group `often`."""
    group = parser.add_argument_group("watching")
    group.add_argument(
        "--name",
        metavar="NAME",
        help="name by which hil-bench watch, hil-bench ctl and hil_bench.attach() find this bench "
        f"(default {NAME}, {NAME}-2, ...)",
    )
    group.add_argument(
        "--no-feed", action="store_true", help="let nobody watch this bench or give it commands"
    )
    often.add_argument(
        "--panel",
        action="store_true",
        help="serve the web page of hil-bench panel, too, in a process of its own",
    )


def check_options(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if not args.panel:
        return
    if args.no_feed or not HAS_SOCKETS:
        why = "--no-feed" if args.no_feed else "this machine has no Unix sockets"
        raise ConfigError(f"--panel: needs the feed, which is off ({why}); leave one out")
    check_panel_argument()


def check_panel_argument() -> None:
    """Refuse --panel where it cannot be.

    Raises:
        ConfigError: its libraries are missing.
    """
    if importlib.util.find_spec("uvicorn") is None or importlib.util.find_spec("starlette") is None:
        raise ConfigError("--panel needs an extra; pip install 'hil-bench[panel]'")
