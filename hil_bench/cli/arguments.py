"""Arguments that name a bench, its file, seed, bus and axis; and where output goes."""

import argparse
import contextlib
import math
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

from hil_bench.bench.configuration import BenchConfig, OverrunPolicy, RealtimePolicy, load_config
from hil_bench.bench.configuration.keys import REALTIME_KEYS
from hil_bench.cli.bus_arguments import add_bus_arguments
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError, about_file
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, require_cylinder

_LOOP_KEYS = ("sync_period_us", *(key.name for key in REALTIME_KEYS))
_NOT_CLASSICAL = {"fd": "--fd", "data_bitrate": "--data-bitrate", "timing": "--timing"}


BUILT_IN = "the built-in bench of one axis"
"""What a verb takes where no bench is named."""


def add_bench_arguments(parser: argparse.ArgumentParser, *, otherwise: str = BUILT_IN) -> None:
    """Add the arguments that `load_bench_config` reads.

    Args:
        parser: of the verb.
        otherwise: what the verb takes where no bench is named.
    """
    parser.add_argument(
        "config",
        nargs="?",
        metavar="bench.toml",
        help=f"the bench (default: HIL_BENCH_CONFIG, else {otherwise})",
    )
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="seed of all random generators (default: that of the bench)",
    )
    add_bus_arguments(parser)


def add_loop_arguments(parser: argparse.ArgumentParser) -> "argparse._ActionsContainer":
    """Add the arguments that say how a paced loop runs, and return their group.

    `load_bench_config` reads them.
    """
    group = parser.add_argument_group("real time (docs/realtime.md; 'hil-bench doctor')")
    group.add_argument(
        "--realtime",
        choices=[policy.value for policy in RealtimePolicy],
        help="scheduling policy SCHED_FIFO or SCHED_DEADLINE, with locked memory (default: off)",
    )
    group.add_argument(
        "--realtime-priority",
        type=int,
        metavar="N",
        help="priority of SCHED_FIFO, 1 to 98 (default: 80)",
    )
    group.add_argument(
        "--realtime-cpu", type=int, metavar="N", help="run the loop on processor N only, as in 3"
    )
    group.add_argument(
        "--realtime-spin-us",
        type=int,
        metavar="US",
        help="wait busily for the last microseconds before each tick, as in 200; costs that share "
        "of the loop's processor",
    )
    group.add_argument(
        "--overrun",
        choices=[policy.value for policy in OverrunPolicy],
        help="after a tick that took too long: catch up with the late ticks (count, the default), "
        f"skip them and keep the phase, or stop with exit code {ExitCode.TIMING}",
    )
    return group


def add_fault_arguments(parser: "argparse._ActionsContainer") -> None:
    """Add `--fault`, which `load_bench_config` reads."""
    parser.add_argument(
        "--fault",
        nargs="+",
        action="append",
        default=[],
        metavar="WORD",
        help="fault as KIND TARGET [KEY=VALUE ...], as in 'freeze pressure_a at_s=2 for_s=1'; "
        "repeat it for more faults (docs/faults.md)",
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


def parse_fault(words: Sequence[str], option: str = "--fault") -> dict[str, object]:
    """Return the table of `[[faults]]` that the words of `--fault` stand for.

    Args:
        words: given to it.
        option: how messages name it.

    Raises:
        ConfigError: they are not KIND TARGET [KEY=VALUE ...].
    """
    pairs = [word.partition("=") for word in words[2:]]
    if len(words) < 2 or "=" in "".join(words[:2]) or not all(sign for _, sign, _ in pairs):
        right = "give KIND TARGET [KEY=VALUE ...], as in freeze pressure_a at_s=2"
        raise ConfigError(f"{option} {' '.join(words)}: is no fault; {right}")
    return {
        "kind": words[0],
        "target": words[1],
        **{key: parse_value(value) for key, _, value in pairs},
    }


def parse_value(text: str) -> object:
    """Return a value of TOML, or else the text itself, so that no word needs quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def load_bench_config(args: argparse.Namespace, *, modbus: bool = False) -> BenchConfig:
    """Return the configuration with what the command line says of it.

    Args:
        args: the command line.
        modbus: as for `load_config`.

    Raises:
        ConfigError: the configuration is wrong, or an option is none of classical CAN.
    """
    for name, option in _NOT_CLASSICAL.items():
        if name in args:
            raise ConfigError(f"{option}: CANopen is classical CAN; give -b or leave it out")
    return load_config(
        args.config,
        seed=args.seed,
        interface=getattr(args, "interface", None),
        channel=getattr(args, "channel", None),
        bitrate=getattr(args, "bitrate", None),
        bus_options=getattr(args, "bus_kwargs", None),
        loop={name: getattr(args, name, None) for name in _LOOP_KEYS},
        modbus=modbus,
        faults=[parse_fault(words) for words in getattr(args, "fault", [])],
        tables=getattr(args, "tables", None),
    )


def read_speed(text: str) -> float:
    """Return a speed.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        speed = math.inf if text == "max" else float(text)
    except ValueError:
        speed = math.nan
    if not speed > 0:
        raise argparse.ArgumentTypeError(f"{text!r}: give a positive number, or max")
    return speed


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


def make_directory(path: Path) -> None:
    """Make the output directory where it is not there yet."""
    with about_file(f"--output {path}", what="cannot be made", right="give a directory of yours"):
        path.mkdir(parents=True, exist_ok=True)


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
