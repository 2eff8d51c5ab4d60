"""The bench's own end of a bus: one that is there, or a hub that it hosts."""

import argparse
import contextlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

from hil_bench.config import BenchConfig
from hil_bench.errors import BusError
from hil_bench.transports.bus_load import USUAL_BITRATE
from hil_bench.transports.can_interfaces import bitrate_of
from hil_bench.transports.hosted_bus import HostedBus
from hil_bench.transports.hub_process import HubProcess
from hil_bench.transports.opening import open_transport
from hil_bench.transports.socketcan import SocketCanTransport
from hil_bench.transports.transport import Transport

HUB_CHANNEL = "can0"


class OpenBus(NamedTuple):
    """A bus that is open.

    Attributes:
        transport: the bench's end of it.
        join: python-can's flags for another program's end, empty where the bus says it all.
        check: raises a `BusError` when the bus is gone without the transport noticing.
        bitrate: that the bus's load refers to [bit/s].
    """

    transport: Transport
    join: str
    check: Callable[[], None]
    bitrate: int


@contextlib.contextmanager
def open_bus(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenBus]:
    """Open the bus of the configuration, or host one and join it.

    Yields:
        The bus.
    """
    with contextlib.ExitStack() as stack:
        if args.hub is None:
            bus = config.bus
            transport = open_transport(bus.interface, bus.channel, bus.bitrate, bus.options)
            bitrate = bus.bitrate or own_bitrate(transport) or USUAL_BITRATE
            opened = OpenBus(transport, "", lambda: None, bitrate)
        elif args.lockstep:
            hosted = HostedBus(port=args.hub, channel=HUB_CHANNEL)
            flags = join_flags(hosted.host, hosted.port)
            opened = OpenBus(hosted, flags, lambda: None, USUAL_BITRATE)
        else:
            hub = stack.enter_context(HubProcess(port=args.hub, channels=(HUB_CHANNEL,)))
            address = {"host": hub.host, "port": hub.port}
            transport = open_transport("socketcand", HUB_CHANNEL, None, address)
            flags = join_flags(hub.host, hub.port)
            opened = OpenBus(transport, flags, partial(check_hub, hub), USUAL_BITRATE)
        stack.callback(opened.transport.close)
        yield opened


def own_bitrate(transport: Transport) -> int | None:
    """Return the bit rate that a SocketCAN interface is set to [bit/s], None where it has none."""
    return bitrate_of(transport.channel) if isinstance(transport, SocketCanTransport) else None


def join_flags(host: str, port: int) -> str:
    """Return python-can's flags for another program on the hub."""
    return f"-i socketcand -c {HUB_CHANNEL} --bus-kwargs host={host} port={port}"


def check_hub(hub: HubProcess) -> None:
    """Notice that the hub's process is gone.

    Raises:
        BusError: it is.
    """
    if not hub.alive:
        raise BusError(f"hub {hub.host}:{hub.port}: its process has ended; start the bench again")
