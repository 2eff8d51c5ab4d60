"""Arguments that several verbs have: of benches, buses and networks."""

import argparse
import math
import tomllib
from collections.abc import Iterator, Sequence
from typing import Any

from hil_bench.ability import given_to
from hil_bench.bench.configuration import BenchConfig, OverrunPolicy, RealtimePolicy, load_config
from hil_bench.bench.configuration.loop import REALTIME_KEYS
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError

# Arguments that name a CAN bus: python-can's names, spellings and choices.
#
# `can.cli.add_bus_arguments` has the same, but wants python-can imported, half of a start of
# `hil-bench check`. Here it is imported when one of these options is given, or help is shown.


class _Interfaces:
    """The names of python-can's interfaces, looked up when they are needed."""

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._names()))

    @staticmethod
    def _names() -> frozenset[str]:
        from can import VALID_INTERFACES  # noqa: PLC0415 - see above

        return VALID_INTERFACES


class _BusOptions(argparse.Action):
    """Reads NAME=VALUE words into a dictionary, values converted as python-can does."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,  # noqa: ARG002 - argparse gives it
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,  # noqa: ARG002 - likewise
    ) -> None:
        from can.util import cast_from_string  # noqa: PLC0415 - see above

        read = {}
        for word in values or ():
            name, sign, value = word.partition("=")
            if not (sign and name.isascii() and name.isidentifier()):
                right = "give NAME=VALUE, as in port=29536"
                raise argparse.ArgumentError(self, f"{word!r} is no bus option; {right}")
            read[name] = cast_from_string(value)
        setattr(namespace, self.dest, read)


def add_bus_arguments(parser: argparse.ArgumentParser, title: str = "bus") -> None:
    """Add the arguments of a bus, absent from the namespace where they are not given.

    That of bit timing is known only for `load_bench_config` to say why it is wrong.

    Args:
        parser: takes the arguments.
        title: of their group; the help adds that they are python-can's.
    """
    group = parser.add_argument_group(
        f"{title} (as in python-can)", argument_default=argparse.SUPPRESS
    )
    group.add_argument(
        "-c", "--channel", metavar="CHANNEL", help="channel of the interface, as in can0"
    )
    group.add_argument(
        "-i",
        "--interface",
        choices=_Interfaces(),
        metavar="INTERFACE",  # or each usage line shows all two dozen of them
        help="python-can's interface (default: of its configuration): %(choices)s",
    )
    group.add_argument(
        "-b", "--bitrate", type=int, metavar="BITRATE", help="bit rate in bit/s, as in 500000"
    )
    group.add_argument("--fd", action="store_true", help="the bus carries CAN FD, too")
    group.add_argument(
        "--data-bitrate",
        type=int,
        metavar="BITRATE",
        help="bit rate of the data phase of CAN FD in bit/s, as in 2000000",
    )
    group.add_argument("--timing", nargs="+", help=argparse.SUPPRESS)
    group.add_argument(
        "--bus-kwargs",
        action=_BusOptions,
        nargs="+",
        metavar="NAME=VALUE",
        help="further options of the interface, as in host=127.0.0.1 port=29536",
    )


# Arguments that name a bench, its file, seed, bus and axis; and where output goes.

_LOOP_KEYS = ("sync_period_us", *(key.name for key in REALTIME_KEYS))
_FD_OPTIONS = ("fd", "data_bitrate")


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


def parse_value(text: str) -> object:
    """Return a value of TOML, or else the text itself, so that no word needs quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def load_bench_config(args: argparse.Namespace, **given: object) -> BenchConfig:
    """Return the configuration with what the command line says of it.

    Args:
        args: the command line.
        given: as for `load_config`.

    Raises:
        ConfigError: the configuration is wrong, or an option is not for this program.
    """
    if "timing" in args:
        raise ConfigError("--timing: bit timing is the adapter's; give -b or leave it out")
    for module in given_to("arguments"):
        given |= module.given(args)
    options = {name: getattr(args, name) for name in _FD_OPTIONS if name in args}
    return load_config(
        args.config,
        seed=args.seed,
        interface=getattr(args, "interface", None),
        channel=getattr(args, "channel", None),
        bitrate=getattr(args, "bitrate", None),
        bus_options=(getattr(args, "bus_kwargs", None) or {}) | options,
        loop={name: getattr(args, name, None) for name in _LOOP_KEYS},
        tables=getattr(args, "tables", None),
        **given,
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
