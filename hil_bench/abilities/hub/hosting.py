"""The buses of a bench on a hub that `hil-bench run` hosts."""

import argparse
import contextlib
import math
from collections.abc import Mapping, Sequence

from hil_bench.abilities.hub.process import HubProcess, HubTransport
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.run_setup import OpenBus, bus_lines, joined
from hil_bench.outside.bits import USUAL_BITRATE


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


def open_hub(args: argparse.Namespace, config: BenchConfig, stack: contextlib.ExitStack) -> OpenBus:
    """Start a hub in a process of its own, and join each of its buses."""
    channels = hub_channels(config)
    bitrates = [bus.bitrate or USUAL_BITRATE for bus in config.buses.values()]
    is_limited = not args.hub_unlimited and math.isfinite(args.speed)
    hub = HubProcess(
        port=args.hub,
        channels=tuple(channels.values()),
        bitrate=max(bitrates) * args.speed if is_limited else None,
        fd=fd_speedups(config),
    )
    stack.enter_context(hub)
    parts = {}
    for name, channel in channels.items():
        parts[name] = hub.join(channel)
        stack.callback(parts[name].close)
    lines = (*bus_lines(parts), *join_lines(channels, hub.host, hub.port))
    helpers = [HubHelper(hub, list(parts.values()))]
    return OpenBus(joined(parts), parts, lines, helpers, sum(bitrates))


def hub_channels(config: BenchConfig) -> dict[str, str]:
    """Return the channel of each bus on a hub, by the bus' name."""
    return {name: f"can{number}" for number, name in enumerate(config.buses)}


def fd_speedups(config: BenchConfig) -> dict[str, float]:
    """Return the channels of CAN FD on a hub, with `BusConfig.speedup` of each."""
    channels = hub_channels(config)
    return {channels[name]: bus.speedup for name, bus in config.buses.items() if bus.fd}


def join_lines(channels: Mapping[str, str], host: str, port: int) -> tuple[str, ...]:
    """Return python-can's flags for another program on each bus of a hub."""
    return tuple(
        f"join   -i socketcand -c {channel} --bus-kwargs host={host} port={port}"
        + (f"    ({name})" if len(channels) > 1 else "")
        for name, channel in channels.items()
    )
