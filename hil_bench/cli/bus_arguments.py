"""Arguments that name a CAN bus: python-can's names, spellings and choices.

`can.cli.add_bus_arguments` has the same, but wants python-can imported, half of a start of
`hil-bench check`. Here it is imported when one of these options is given, or help is shown.
"""

import argparse
from collections.abc import Iterator, Sequence
from typing import Any


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

    Those of CAN FD and bit timing are known only for `load_bench_config` to say why they are wrong.

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
    group.add_argument("--fd", action="store_true", help=argparse.SUPPRESS)
    group.add_argument("--data-bitrate", help=argparse.SUPPRESS)
    group.add_argument("--timing", nargs="+", help=argparse.SUPPRESS)
    group.add_argument(
        "--bus-kwargs",
        action=_BusOptions,
        nargs="+",
        metavar="NAME=VALUE",
        help="further options of the interface, as in host=127.0.0.1 port=29536",
    )
