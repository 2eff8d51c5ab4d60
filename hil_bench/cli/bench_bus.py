"""The bench's own end of its buses: those that are there, or a hub that it hosts."""

import argparse
import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.helpers import Helper
from hil_bench.outside.transports.bus_load import USUAL_BITRATE
from hil_bench.outside.transports.can_interfaces import bitrate_of
from hil_bench.outside.transports.hosted_bus import HostedBus
from hil_bench.outside.transports.hub_process import HubProcess
from hil_bench.outside.transports.hub_transport import HubTransport
from hil_bench.outside.transports.joined import JoinedTransport
from hil_bench.outside.transports.opening import open_transport
from hil_bench.outside.transports.socketcan import SocketCanTransport
from hil_bench.outside.transports.transport import Transport

HUB_CHANNEL = "can0"


class OpenBus(NamedTuple):
    """The bus of a bench, or its buses, open.

    Attributes:
        transport: the bench's end of it, or of all of them as one.
        parts: each bus by its name in the configuration.
        lines: what a controller engineer needs to know to join.
        helpers: the process of its hub.
        bitrate: that the load refers to, of all buses together [bit/s].
    """

    transport: Transport
    parts: Mapping[str, Transport]
    lines: tuple[str, ...]
    helpers: Sequence[Helper]
    bitrate: int


class HubHelper:
    """A hub's process, as the loop looks after it.

    Args:
        hub: it runs.
        ends: the bench's end of each of its buses.
    """

    loss = "all programs on it are cut off and have to join again"
    is_needed = True

    def __init__(self, hub: HubProcess, ends: Sequence[HubTransport]) -> None:
        self.name = f"hub {hub.host}:{hub.port}"
        self._hub = hub
        self._ends = tuple(ends)

    def ending(self) -> str | None:
        """Return the ending of the process or its cut-off of the bench; None for neither."""
        ending = self._hub.ending()
        if ending is not None:
            for end in self._ends:
                end.drop()
        elif any(end.is_down for end in self._ends):
            return "has cut off the bench, which was too slow for it"
        return ending

    def restart(self) -> str:
        """Start it again at the same port where it has ended, and join each of its buses."""
        if self._hub.ending() is not None:
            self._hub.restart()
        for end in self._ends:
            if end.is_down:
                end.join()
        return ""


@contextlib.contextmanager
def open_bus(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenBus]:
    """Open the buses of the configuration, or host as many and join them.

    Yields:
        The buses.
    """
    with contextlib.ExitStack() as stack:
        if args.hub is None:
            yield _open_configured(config, stack)
        elif args.lockstep:
            channels = hub_channels(config)
            hosted = HostedBus(port=args.hub, channels=list(channels.values()))
            stack.callback(hosted.close)
            lines = (
                f"bus    {hosted.description}",
                *_join_lines(channels, hosted.host, hosted.port),
            )
            bitrate = USUAL_BITRATE * len(channels)
            yield OpenBus(hosted, {"bus": hosted}, lines, (), bitrate)
        else:
            yield _open_hub(args, config, stack)


def _open_configured(config: BenchConfig, stack: contextlib.ExitStack) -> OpenBus:
    parts = {}
    for name, bus in config.buses.items():
        parts[name] = open_transport(bus.interface, bus.channel, bus.bitrate, bus.options)
        stack.callback(parts[name].close)
    bitrate = sum(
        bus.bitrate or own_bitrate(parts[name]) or USUAL_BITRATE
        for name, bus in config.buses.items()
    )
    return OpenBus(_joined(parts), parts, _bus_lines(parts), (), bitrate)


def _open_hub(
    args: argparse.Namespace, config: BenchConfig, stack: contextlib.ExitStack
) -> OpenBus:
    """Start a hub in a process of its own, and join each of its buses."""
    channels = hub_channels(config)
    bitrates = [bus.bitrate or USUAL_BITRATE for bus in config.buses.values()]
    is_limited = not args.hub_unlimited and math.isfinite(args.speed)
    hub = HubProcess(
        port=args.hub,
        channels=tuple(channels.values()),
        bitrate=max(bitrates) * args.speed if is_limited else None,
    )
    stack.enter_context(hub)
    parts = {}
    for name, channel in channels.items():
        parts[name] = hub.join(channel)
        stack.callback(parts[name].close)
    lines = (*_bus_lines(parts), *_join_lines(channels, hub.host, hub.port))
    helpers = [HubHelper(hub, list(parts.values()))]
    return OpenBus(_joined(parts), parts, lines, helpers, sum(bitrates))


def _joined(parts: Mapping[str, Transport]) -> Transport:
    """Return several buses as one, and a single one as it is."""
    transports = tuple(parts.values())
    return transports[0] if len(transports) == 1 else JoinedTransport(transports)


def _bus_lines(parts: Mapping[str, Transport]) -> tuple[str, ...]:
    """Return the description of each bus, with its name where there are several."""
    if len(parts) == 1:
        return tuple(f"bus    {part.description}" for part in parts.values())
    return tuple(f"bus    {name}: {part.description}" for name, part in parts.items())


def own_bitrate(transport: Transport) -> int | None:
    """Return the bit rate that a SocketCAN interface is set to [bit/s], None where it has none."""
    return bitrate_of(transport.channel) if isinstance(transport, SocketCanTransport) else None


def hub_channels(config: BenchConfig) -> dict[str, str]:
    """Return the channel of each bus on a hub, by the bus' name."""
    return {name: f"can{number}" for number, name in enumerate(config.buses)}


def _join_lines(channels: Mapping[str, str], host: str, port: int) -> tuple[str, ...]:
    """Return python-can's flags for another program on each bus of a hub."""
    return tuple(
        f"join   -i socketcand -c {channel} --bus-kwargs host={host} port={port}"
        + (f"    ({name})" if len(channels) > 1 else "")
        for name, channel in channels.items()
    )
