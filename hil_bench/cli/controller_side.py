"""The bus of the verbs that talk to devices as a controller does."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_bench.outside.transports.opening import open_can_bus, open_transport
from hil_bench.session.lockstep_controller import LockStepController
from hil_bench.session.virtual_bench import VirtualBench
from hil_drivers import BusLostError, Network


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


def add_network_arguments(parser: argparse._ActionsContainer) -> None:
    """Add what says where the devices are: on which bus, or in the virtual bench."""
    parser.add_argument(
        "--on",
        metavar="NAME",
        help="the bus of [buses.NAME], where the bench has several (default: that of [bus])",
    )
    parser.add_argument(
        "--virtual",
        action="store_true",
        help="no bus: the virtual bench of the configuration, in this process and virtual time",
    )


def seen_from_bus(args: argparse.Namespace, config: BenchConfig) -> BenchConfig:
    """Return what of a bench is on the bus of ``--on``.

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
            bench = stack.enter_context(VirtualBench(config))
            network = stack.enter_context(
                Network(bench.buses[args.on or FIRST_BUS], clock=bench.now)
            )
            bench.pump = network.pump
            opened = OpenNetwork(network, "virtual bench", bench)
        elif getattr(args, "lockstep", False):
            opened = stack.enter_context(_open_lockstep(seen))
        else:
            bus, what = open_can_bus(*seen.bus.address)
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
    transport = open_transport(*config.bus.address)
    with contextlib.closing(transport):
        producer = LockStepController(transport, [node.node_id for node in config.nodes])
        producer.join()
        description = f"{transport.description} in lock-step"
        with (
            EmbeddedBus(producer.tick, config.sync_period_ns, description=description) as stepped,
            Network(stepped, clock=stepped.now) as network,
        ):
            yield OpenNetwork(network, description, None, is_lockstep=True)
