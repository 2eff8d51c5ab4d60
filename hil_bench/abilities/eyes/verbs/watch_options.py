"""The options of `hil-bench watch` for a bus; nothing here imports its frame readers."""

import argparse

from hil_bench.abilities.eyes.verbs.eyes_arguments import add_listening_arguments
from hil_bench.errors import ConfigError

_BUS_WORDS = ("interface", "channel", "bitrate", "bus_kwargs", "fd", "data_bitrate", "timing")


def add_options(parser: argparse.ArgumentParser, _: "argparse._ActionsContainer") -> None:
    """Add the bus and its nodes."""
    add_listening_arguments(parser, assumes=False)


def take_over(args: argparse.Namespace) -> int | None:
    """Watch a bus where the command line names one."""
    if not _is_for_bus(args):
        return None
    from hil_bench.abilities.common.terminal import make_console  # noqa: PLC0415 - likewise
    from hil_bench.abilities.eyes.verbs.watch_bus import watch_bus  # noqa: PLC0415 - brings much

    return watch_bus(args, make_console(once=args.once))


def _is_for_bus(args: argparse.Namespace) -> bool:
    """Return True if a command line names a bus rather than a bench that runs.

    Raises:
        ConfigError: it names both.
    """
    is_bus = any(name in args for name in _BUS_WORDS) or any((args.config, args.on, args.eds))
    if is_bus and args.bench:
        raise ConfigError(
            f"--bench {args.bench}: is a bench that runs here; a bench.toml, -i, -c, --on and "
            "--eds are for a bus; give either"
        )
    return is_bus
