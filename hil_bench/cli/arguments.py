"""Arguments that name a bench: its file, its seed, its bus."""

import argparse

from can.cli import add_bus_arguments

from hil_bench.config import BenchConfig, load_config
from hil_bench.errors import ConfigError

_NOT_CLASSICAL = {"fd": "--fd", "data_bitrate": "--data-bitrate", "timing": "--timing"}


def add_bench_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that `load_bench_config` reads; those of the bus are python-can's own."""
    parser.add_argument(
        "config",
        nargs="?",
        metavar="bench.toml",
        help="the bench; without it HIL_BENCH_CONFIG, or else the built-in bench of one axis",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random generators")
    add_bus_arguments(parser, group_title="bus (as in python-can)")


def load_bench_config(args: argparse.Namespace) -> BenchConfig:
    """Return the configuration with what the command line says of it.

    Raises:
        ConfigError: the configuration is wrong, or an option is none of classical CAN.
    """
    for name, option in _NOT_CLASSICAL.items():
        if name in args:
            raise ConfigError(f"{option}: CANopen is classical CAN; give -b or leave it out")
    return load_config(
        args.config,
        seed=args.seed,
        sync_period_us=getattr(args, "sync_period_us", None),
        interface=getattr(args, "interface", None),
        channel=getattr(args, "channel", None),
        bitrate=getattr(args, "bitrate", None),
        bus_options=getattr(args, "bus_kwargs", None),
    )
