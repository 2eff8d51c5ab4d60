"""The bus of the verbs that talk to devices as a controller does."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from drivers import BusLostError, Network
from hil_bench.config import BenchConfig
from hil_bench.errors import BusError, ConfigError
from hil_bench.transports.opening import open_can_bus
from hil_bench.virtual_bench import VirtualBench


class OpenNetwork(NamedTuple):
    """A bus that is open, with the drivers' network on it.

    Attributes:
        network: the drivers' network.
        description: the bus for people: "socketcan can0".
        virtual: the bench behind it, None on a bus of its own.
    """

    network: Network
    description: str
    virtual: VirtualBench | None


def add_virtual_argument(parser: argparse._ActionsContainer) -> None:
    """Add the flag that takes the virtual bench in place of a bus."""
    parser.add_argument(
        "--virtual",
        action="store_true",
        help="no bus: the virtual bench of the configuration, in this process and virtual time",
    )


@contextlib.contextmanager
def open_network(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenNetwork]:
    """Open the bus of the configuration, or the virtual bench.

    Yields:
        The open network.

    Raises:
        ConfigError: --virtual and a bus.
        BusError: the bus was lost.
    """
    if args.virtual and ("interface" in args or "channel" in args):
        raise ConfigError("--virtual needs no bus; give either --virtual or -i and -c")
    with contextlib.ExitStack() as stack:
        if args.virtual:
            bench = stack.enter_context(VirtualBench(config))
            network = stack.enter_context(Network(bench.bus, clock=bench.now))
            bench.pump = network.pump
            opened = OpenNetwork(network, "virtual bench", bench)
        else:
            bus, what = open_can_bus(
                config.bus.interface, config.bus.channel, config.bus.bitrate, config.bus.options
            )
            stack.enter_context(bus)
            opened = OpenNetwork(stack.enter_context(Network(bus)), what, None)
        try:
            yield opened
        except BusLostError as error:
            raise BusError(str(error)) from error
