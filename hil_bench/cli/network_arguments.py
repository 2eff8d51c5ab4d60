"""Arguments that say where the devices are: on which bus, or in the virtual bench."""

import argparse

from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import ConfigError


def add_network_arguments(parser: argparse._ActionsContainer) -> None:
    """Add what says where the devices are: on which bus, or in the virtual bench."""
    parser.add_argument(
        "--on",
        metavar="NAME",
        help="use the bus of [buses.NAME] in a bench with several (default: that of [bus])",
    )
    parser.add_argument(
        "--virtual",
        action="store_true",
        help="use no bus, but the virtual bench in this process, in virtual time",
    )


def seen_from_bus(args: argparse.Namespace, config: BenchConfig) -> BenchConfig:
    """Return the part of a bench that is on the bus of ``--on``.

    Raises:
        ConfigError: there is no such bus, or the command line gives another one.
    """
    name = args.on or FIRST_BUS
    if name not in config.buses:
        raise ConfigError(
            f"--on {name}: there is no such bus; give one of {', '.join(config.buses)}"
        )
    if name != FIRST_BUS and ("interface" in args or "channel" in args):
        raise ConfigError(f"--on {name}: -i and -c are for [bus]; give either")
    if name != FIRST_BUS and getattr(args, "lockstep", False):
        raise ConfigError(f"--on {name}: in lock-step SYNC on [bus] lets time pass; leave --on out")
    return config.seen_from(name)


def bus_words(args: argparse.Namespace) -> list[str]:
    """Return the words of a command line that name the same bus."""
    words = ["--on", args.on] if args.on else []
    if args.virtual:
        return [*words, "--virtual"]
    for flag, name in (("-i", "interface"), ("-c", "channel"), ("-b", "bitrate")):
        if name in args:
            words += [flag, str(getattr(args, name))]
    options = getattr(args, "bus_kwargs", None) or {}
    if options:
        words += ["--bus-kwargs", *(f"{name}={value}" for name, value in options.items())]
    return words


def check_one_bus(config: BenchConfig, verb: str) -> None:
    """Refuse a bench with several buses.

    Raises:
        ConfigError: it has.
    """
    if config.further_buses:
        names = ", ".join(config.buses)
        right = f"give {verb} a bench.toml with all nodes on one"
        raise ConfigError(f"{config.path}: has several buses ({names}); {right}")
