"""The bus of the verbs that talk to devices as a controller does."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from drivers import BusLostError, Network
from hil_bench.config import BenchConfig
from hil_bench.errors import BusError, ConfigError
from hil_bench.transports.embedded import EmbeddedBus
from hil_bench.transports.opening import open_can_bus, open_transport
from hil_bench.transports.sync_producer import SyncProducer
from hil_bench.virtual_bench import VirtualBench


class OpenNetwork(NamedTuple):
    """A bus that is open, with the drivers' network on it.

    Attributes:
        network: the drivers' network.
        description: the bus for people: "socketcan can0".
        virtual: the bench behind it, None on a bus of its own.
        is_lockstep: whether our SYNC lets the bench's time pass.
    """

    network: Network
    description: str
    virtual: VirtualBench | None
    is_lockstep: bool = False


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
        elif getattr(args, "lockstep", False):
            opened = stack.enter_context(_open_lockstep(config))
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


@contextlib.contextmanager
def _open_lockstep(config: BenchConfig) -> Iterator[OpenNetwork]:
    """Open the bus of the configuration, whose bench our SYNC moves.

    Yields:
        The open network.
    """
    bus = config.bus
    transport = open_transport(bus.interface, bus.channel, bus.bitrate, bus.options)
    with contextlib.closing(transport):
        producer = SyncProducer(transport, [node.node_id for node in config.nodes])
        producer.join()
        description = f"{transport.description} in lock-step"
        with (
            EmbeddedBus(producer.tick, config.sync_period_ns, description=description) as stepped,
            Network(stepped, clock=stepped.now) as network,
        ):
            yield OpenNetwork(network, description, None, is_lockstep=True)
