"""A full 1 Mbit/s bus, a quarter of it for the built-in bench.

    python benchmarks/full_bus.py [--seconds S] [--repeats N]

The peer in the same run is `canopen.LocalNode` of the canopen library, from the same EDS files,
four as here, without a plant. Its frames go to a list, as ours do.
"""

import argparse
import itertools
import struct
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import canopen

import occasion
from device_profiles import ENCODER_406, PRESSURE_404, VALVE_408
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.paced import RunReport, run_paced
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import TransportCounters
from hil_bench.plants.hydraulic_cylinder.model import PlantInput
from master import NMT_START, TICK, demand, download, upload
from peers import CanopenNetwork

FULL_BUS = 8000
"""Frames of eight bytes that 1 Mbit/s carries in a second."""

MAP_EIGHT_BYTES = (
    # RPDO1 off; control word, set-point and a dummy of 32 bit; on again.
    download(1, 0x1400, 1, bytes.fromhex("01020080")),
    download(1, 0x1600, 0, b"\0"),
    download(1, 0x1600, 3, bytes.fromhex("20000700")),
    download(1, 0x1600, 0, b"\3"),
    download(1, 0x1400, 1, bytes.fromhex("01020000")),
)


class FullBusTraffic:
    """The frames of a full bus, a quarter of them for the built-in bench.

    Of eight frames one is the valve's RPDO, mapped to eight bytes, one an SDO request to each of
    the four nodes in turn, and six are between others.

    Attributes:
        requests: SDO requests so far.
        commands: RPDOs so far.
    """

    def __init__(self) -> None:
        self.requests = 0
        self.commands = 0

    def __iter__(self) -> Iterator[Frame]:
        others = [Frame(0x300 + number, bytes(8)) for number in range(6)]
        for request in MAP_EIGHT_BYTES:
            yield from others * 10  # more than a tick takes, so that one follows the other
            self.requests += 1
            yield request
        yield from others * 10
        yield NMT_START
        while True:
            self.commands += 1
            setpoint = 8000 if self.commands & 512 else -8000
            yield Frame(0x201, struct.pack("<Hhi", 7, setpoint, self.commands))
            yield from others[:3]
            self.requests += 1
            yield upload(1 + self.requests % 4, 0x1018, 4)
            yield from others[3:]


class FullBus:
    """An in-memory bus whose frames arrive by the clock, as on a wire."""

    description = "in-memory bus, full"
    has_exact_wait = False

    def __init__(self, clock: Clock) -> None:
        self.traffic = FullBusTraffic()
        self.answers = 0
        self.largest_backlog = 0
        self._frames = iter(self.traffic)
        self._clock = clock
        self._start: int | None = None
        self._taken = 0
        self._sent = 0

    def receive(self, limit: int) -> list[Frame]:
        """Return the frames that have arrived by now."""
        now = self._clock.now()
        if self._start is None:
            self._start = now
        arrived = (now - self._start) * FULL_BUS // 1_000_000_000
        waiting = arrived - self._taken
        self.largest_backlog = max(self.largest_backlog, waiting)
        count = min(waiting, limit)
        self._taken += count
        return list(islice(self._frames, count))

    def wait(self, timeout: float) -> bool:
        """Return at once: there is always something soon."""
        return timeout >= 0.0

    def send(self, frames: Sequence[Frame]) -> None:
        """Count the frames."""
        self._sent += len(frames)
        self.answers += count_answers(frames)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Filter nothing: Python sees every frame of the bus."""

    def counters(self) -> TransportCounters:
        """Return the counts of frames."""
        return TransportCounters(received=self._taken, sent=self._sent)

    def close(self) -> None:
        """Do nothing."""


def count_answers(frames: Sequence[Frame]) -> int:
    """Count the SDO answers among the frames."""
    return sum(0x580 < frame.can_id < 0x600 for frame in frames)


class Service(NamedTuple):
    """The figures of a bus served in real time.

    Attributes:
        report: of the loop.
        bus: what passed.
        commands: RPDOs whose values reached the objects.
        cpu: share of one core.
    """

    report: RunReport
    bus: FullBus
    commands: int
    cpu: float


def serve_full_bus(seconds: float) -> Service:
    """Serve a full bus in real time, 1000 ticks a second."""
    bench = build_bench(load_config())
    bench.axes[0].plant.step(PlantInput(0.0), 1)  # or Numba would load in the first tick
    commands = itertools.count()
    bench.nodes[0].object_dictionary.add_hook(0x6040, 0, lambda _word: next(commands))
    clock = MonotonicClock()
    pacer = Pacer(clock, TICK)
    bus, ticks = FullBus(clock), round(seconds * 1000)
    start, cpu = time.perf_counter(), time.process_time()
    report = run_paced(Session(bench), bus, pacer, stopped=lambda: pacer.statistics.ticks >= ticks)
    share = (time.process_time() - cpu) / (time.perf_counter() - start)
    return Service(report, bus, next(commands), share)


def full_bus_work(seconds: int) -> float:
    """Return the work of the bench for one second of a full bus, plant included [s]."""
    bench = build_bench(load_config())
    bench.start(0)
    traffic = FullBusTraffic()
    frames, answers, busy = iter(traffic), 0, 0.0
    for number in range(1, seconds * 1000 + 1):
        received = list(islice(frames, FULL_BUS // 1000))
        start = time.perf_counter()
        sent = bench.tick(received, number * TICK)
        busy += time.perf_counter() - start
        answers += count_answers(sent)
    demand(traffic.requests, answers, "SDO answers")
    return busy / seconds


def peer_full_bus_work(seconds: int) -> float:
    """Return the work of four nodes of the peer for one second of a full bus, no plant [s]."""
    network = CanopenNetwork()
    for node_id, eds in enumerate((VALVE_408, PRESSURE_404, PRESSURE_404, ENCODER_406), start=1):
        network.add_node(canopen.LocalNode(node_id, str(eds)))
    traffic = FullBusTraffic()
    frames, answers, busy = iter(traffic), 0, 0.0
    for number in range(seconds * FULL_BUS):
        frame = next(frames)
        if frame is NMT_START:
            network.nodes[1].rpdo.read()
        start = time.perf_counter()
        sent = network.exchange(frame)
        busy += time.perf_counter() - start
        answers += sum(0x580 < can_id < 0x600 for can_id, _ in sent)
        del number
    demand(traffic.requests, answers, "SDO answers")
    return busy / seconds


def print_bus(work: float, peer: float, service: Service) -> None:
    """Print the figures of a full bus."""
    ticks, traffic = service.report.ticks, service.bus.traffic
    print(f"| full bus, {FULL_BUS} frames/s | figure |\n|---|---|")
    print(f"| work for one second of it, four nodes and plant | {work * 1e3:.0f} ms |")
    print(f"| the same for four `canopen.LocalNode`, no plant | {peer * 1e3:.0f} ms |")
    print(f"| ratio | {work / peer:.2f} |")
    print(f"| in real time: frames taken | {service.report.frames.received} |")
    print(f"| SDO requests unanswered | {traffic.requests - service.bus.answers} |")
    print(f"| RPDOs lost | {traffic.commands - service.commands} |")
    print(f"| ticks skipped, of {ticks.ticks} | {ticks.skipped} |")
    print(f"| ticks that overran | {ticks.overruns} |")
    print(
        f"| work in a tick, median and 99.9th percentile | {ticks.work.p50_us:.0f} us, "
        f"{ticks.work.p999_us:.0f} us |"
    )
    print(f"| most frames that waited | {service.bus.largest_backlog} |")
    print(f"| share of one core | {service.cpu * 100:.0f} % |")


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=7)
    args = occasion.arguments(parser, seconds=0.3, repeats=1)
    work = [(full_bus_work(10), peer_full_bus_work(10)) for _ in range(args.repeats)]
    print(f"work: the least of {args.repeats} rounds, in turns\n")
    print_bus(*map(min, zip(*work, strict=True)), serve_full_bus(args.seconds))


if __name__ == "__main__":
    main()
