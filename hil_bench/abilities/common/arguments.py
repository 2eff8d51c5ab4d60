"""Arguments that verbs of abilities share: networks, foreign tables, output, numbers."""

import argparse
import contextlib
import math
import os
from collections.abc import Iterator
from pathlib import Path

from hil_bench.abilities.common.files import make_directory
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, require_cylinder


def add_column_arguments(parser: "argparse._ActionsContainer") -> None:
    """Add the options that give the quantities of a foreign table's columns."""
    parser.add_argument(
        "--columns",
        type=Path,
        metavar="FILE.toml",
        help="file that gives the quantity of each column, for tables of other tools",
    )
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="COLUMN=QUANTITY:UNIT",
        help="the same for one column; -QUANTITY changes the sign; repeat it for more",
    )


def add_output_argument(parser: argparse.ArgumentParser, default: str, what: str) -> None:
    """Add `--output`, which names the directory for `what`; `make_directory` makes it."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(default),
        metavar="DIR",
        help=f"folder for {what} (default: %(default)s)",
    )


def count_processors() -> int:
    """Return the number of processors that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def find_cylinder(config: BenchConfig, name: str | None, who: str) -> CylinderConfig:
    """Return the axis that `--axis` names, the first one without it, which must be a cylinder.

    Raises:
        ConfigError: the bench has no such axis, or it is another plant than `who` needs.
    """
    axes = {axis.name: axis for axis in config.axes}
    if name is None:
        return require_cylinder(config.first_axis, who)
    if name not in axes:
        raise ConfigError(f"--axis {name}: is no axis of this bench; give {' or '.join(axes)}")
    return require_cylinder(axes[name], who)


@contextlib.contextmanager
def output_directory(path: Path) -> Iterator[None]:
    """Make the output directory; take it away again if the work fails before it wrote anything."""
    made = [each for each in (path, *path.parents) if not each.exists()]
    make_directory(path)
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # something was written
            for each in made:
                each.rmdir()
        raise


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
    return config.seen_from(name)


_BUS_FLAGS = (
    ("-i", "interface"),
    ("-c", "channel"),
    ("-b", "bitrate"),
    ("--data-bitrate", "data_bitrate"),
)


def bus_words(args: argparse.Namespace) -> list[str]:
    """Return the words of a command line that name the same bus."""
    words = ["--on", args.on] if args.on else []
    if args.virtual:
        return [*words, "--virtual"]
    for flag, name in _BUS_FLAGS:
        if name in args:
            words += [flag, str(getattr(args, name))]
    words += ["--fd"] if "fd" in args else []
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


# Numbers on the command line.


def count(text: str) -> int:
    """Return a positive integer.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 1 up")
    return int(text)


def count_from_zero(text: str) -> int:
    """Return an integer that is not negative.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 0 up")
    return int(text)


def positive(text: str) -> float:
    """Return a positive number.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a positive number")
    return number
