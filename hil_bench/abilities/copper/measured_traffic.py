"""Measured traffic of a bench in virtual time: frames, bus load and waiting times."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.section import CopperWire
from hil_bench.abilities.copper.wire.station import BufferConfig, Order
from hil_bench.abilities.copper.wire.wire import Passage
from hil_bench.abilities.eyes.traffic import MeasuredTraffic
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NMT_COB_ID, NmtCommand

_DEPTH: Final = 256
_BOOT_TICKS: Final = 100
_DRIFT: Final = 100


def measure_traffic(
    config: BenchConfig,
    name: str,
    commands: Sequence[Frame],
    *,
    cycle: int,
    bitrate: int,
    duration: int,
    others: Sequence[tuple[Frame, int]] = (),
) -> MeasuredTraffic:
    """Run a bench whose controller starts all nodes and sends the same frames in each cycle.

    Its bus is of copper, with the buffers of `bench.toml`, or sorted ones where that has none. Each
    hundredth cycle is a tick longer, so that the controller meets the nodes' timers in all phases.

    Args:
        config: the whole bench, whose axes may need devices on several buses.
        name: of the bus.
        commands: what the controller sends there in each cycle: SYNC and RPDOs.
        cycle: of the controller [ns].
        bitrate: of the bus [bit/s].
        duration: how long [ns].
        others: frames of others and their periods [ns]; the controller's station sends them, too.
    """
    config, number = _of_copper(config, name, bitrate), list(config.buses).index(name)
    commands = [frame._replace(bus=number) for frame in commands]
    session, found = open_session(config), MeasuredTraffic()
    copper = session.bench.part(Copper)
    session.start()
    boot = config.tick_ns * _BOOT_TICKS
    for now in range(0, boot, config.tick_ns):
        session.tick((), now)
    start = Frame(NMT_COB_ID, bytes((NmtCommand.START, 0)), bus=number)
    due, cycles = boot, 0
    sent = [0] * len(others)
    for now in range(boot, boot + duration, config.tick_ns):
        frames = [start] if now == boot else []
        if now >= due:
            cycles += 1
            due += cycle if cycles % _DRIFT else cycle + config.tick_ns
            frames += commands
        for place, (frame, period) in enumerate(others):
            if now - boot >= sent[place] * period:
                sent[place] += 1
                frames.append(frame._replace(bus=number))
        session.tick(frames, now)
        _count(found, [each for each in copper.passages if each.frame.bus == number])
    found.waiting = sum(station.waiting for station in copper.wiring.buses[number].wire.stations)
    return found


def _count(found: MeasuredTraffic, passages: Sequence[Passage]) -> None:
    """Count what has passed."""
    for each in passages:
        can_id = each.frame.can_id
        found.counts[can_id] = found.counts.get(can_id, 0) + 1
        found.worst[can_id] = max(found.worst.get(can_id, 0), each.end - each.released)
        found.busy += each.end - each.begin


def _of_copper(config: BenchConfig, name: str, bitrate: int) -> BenchConfig:
    """Return a bench one of whose buses has a bit rate and a wire."""
    bus = config.buses[name]
    wire = bus.wire or CopperWire(BufferConfig(_DEPTH, Order.PRIORITY))
    bus = replace(bus, bitrate=bitrate, wire=wire)
    if name == FIRST_BUS:
        return replace(config, bus=bus)
    return replace(config, further_buses={**config.further_buses, name: bus})
