"""The bus of the verbs that talk to devices as a controller does."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.ability import given_to
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.transports.opening import open_can_bus
from hil_drivers import BusLostError, Network

if TYPE_CHECKING:
    from hil_bench.bench.virtual_bench import VirtualBench


class OpenNetwork(NamedTuple):
    """A bus that is open, with the drivers' network on it.

    Attributes:
        network: the drivers' network.
        description: the bus for people: "socketcan can0".
        virtual: the bench behind it, None on a bus of its own.
        is_stepped: whether our SYNC lets the bench's time pass.
    """

    network: Network
    description: str
    virtual: "VirtualBench | None"
    is_stepped: bool = False


@contextlib.contextmanager
def open_network(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenNetwork]:
    """Open a bus of the configuration, or the virtual bench.

    Args:
        args: the command line.
        config: the whole bench, with all its buses.

    Yields:
        The open network.

    Raises:
        ConfigError: --virtual and a bus.
        BusError: the bus was lost.
    """
    if args.virtual and ("interface" in args or "channel" in args):
        raise ConfigError("--virtual needs no bus; give either --virtual or -i and -c")
    seen = seen_from_bus(args, config)
    with contextlib.ExitStack() as stack:
        if args.virtual:
            from hil_bench.bench.virtual_bench import VirtualBench  # noqa: PLC0415 - a whole bench

            bench, name = stack.enter_context(VirtualBench(config)), args.on or FIRST_BUS
            network = stack.enter_context(Network(bench.buses[name], clock=bench.now))
            bench.pump = network.pump
            what = "virtual bench"
            if config.further_buses:
                what += f", --on {name} (its buses: {', '.join(config.buses)})"
            opened = OpenNetwork(network, what, bench)
        elif (other := _open_otherwise(args, seen)) is not None:
            opened = stack.enter_context(other)
        else:
            bus, what = open_can_bus(*seen.bus.address)
            stack.enter_context(bus)
            opened = OpenNetwork(stack.enter_context(Network(bus)), what, None)
        try:
            yield opened
        except BusLostError as error:
            raise BusError(str(error)) from error


def _open_otherwise(
    args: argparse.Namespace, config: BenchConfig
) -> contextlib.AbstractContextManager[OpenNetwork] | None:
    """Open the bus as an ability does whose options are given; None where none are."""
    for module in given_to("network"):
        opened: contextlib.AbstractContextManager[OpenNetwork] | None
        opened = module.open_network(args, config)
        if opened is not None:
            return opened
    return None
