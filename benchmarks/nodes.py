"""127 nodes on one bus in one process, and a full 1 Mbit/s bus.

    python benchmarks/nodes.py [--syncs N] [--seconds S] [--repeats N]

The peer in the same run is `canopen.LocalNode` of the canopen library, from the same EDS files. It
sends no PDO by itself and takes none into its objects, so what an application does there is written
here for it: set the process value, transmit the TPDO on SYNC. Its frames go to a list, as ours do;
neither side has a real bus, a thread or a lock in its way.
"""

import argparse
import gc
import itertools
import platform
import statistics
import struct
import time
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import canopen

from device_profiles import ENCODER_406, PRESSURE_404, VALVE_408
from hil_bench.assembly import build_bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import load_config
from hil_bench.lockstep import LockStep
from hil_bench.plant import PlantInput
from hil_bench.realtime.clock import Clock, MonotonicClock
from hil_bench.realtime.pacer import Pacer
from hil_bench.runner import RunReport, run_paced
from hil_bench.transports.transport import TransportCounters

NODES = 127
TICK = 1_000_000  # [ns]
SYNC = Frame(0x080)
NMT_START = Frame(0x000, b"\x01\x00")
IDENTITY = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4))
"""What an enumeration reads of each node."""

FULL_BUS = 8000
"""Frames of eight bytes that 1 Mbit/s carries in a second."""

_VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
_SENSOR = '[nodes.p{0}]\nprofile = "pressure_404"\nnode_id = {0}\nsource = "{1}"\n'


class OurNodes:
    """A bench of one axis: a valve, and pressure transducers at all other node-IDs."""

    name = "hil-bench"

    def __init__(self, tick_us: int) -> None:
        sensors = (_SENSOR.format(n, "P_A" if n % 2 else "P_B") for n in range(2, NODES + 1))
        with TemporaryDirectory() as folder:
            path = Path(folder) / "bench.toml"
            path.write_text(f"[bench]\ntick_us = {tick_us}\n{_VALVE}{''.join(sensors)}")
            config = load_config(path)
        self.bench = build_bench(config)
        self._lockstep = LockStep(self.bench.tick, self.bench.serve, tick_ns=config.tick_ns)
        self._ticks = 10_000 // tick_us

    def boot(self) -> int:
        """Power all on; return how many booted."""
        self.bench.start(0)
        return len(self._lockstep.receive(SYNC))

    def exchange(self, frame: Frame) -> list[Frame]:
        """Return the answers to a frame."""
        return self._lockstep.receive(frame)

    def synchronise(self) -> int:
        """Move on by 10 ms, the first tick with a SYNC; return how many PDOs were sent."""
        sent = len(self._lockstep.receive(SYNC))
        for _ in range(self._ticks - 1):
            self._lockstep.now += 10_000_000 // self._ticks
            sent += len(self.bench.tick((), self._lockstep.now))
        return sent


class PeerNetwork(canopen.Network):
    """A network of the library whose frames go to a list."""

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[tuple[int, bytes]] = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Keep the frame."""
        del remote
        self.sent.append((can_id, bytes(data)))

    def exchange(self, frame: Frame) -> list[tuple[int, bytes]]:
        """Return the answers to a frame."""
        self.sent = []
        self.notify(frame.can_id, bytearray(frame.data), 0.0)
        return self.sent


class PeerNodes:
    """The same nodes as `canopen.LocalNode`."""

    name = "canopen.LocalNode"

    def __init__(self) -> None:
        self.network = PeerNetwork()
        for node_id in range(1, NODES + 1):
            eds = VALVE_408 if node_id == 1 else PRESSURE_404
            self.network.add_node(canopen.LocalNode(node_id, str(eds)))
        self.network.subscribe(0x080, self._on_sync)

    def boot(self) -> int:
        """Bring all to PRE-OPERATIONAL, which sends the boot-up messages."""
        self.network.sent = []
        for node in self.network.nodes.values():
            node.nmt.state = "INITIALISING"
            node.nmt.state = "PRE-OPERATIONAL"
        return sum(data == b"\x00" for _, data in self.network.sent)

    def exchange(self, frame: Frame) -> list[tuple[int, bytes]]:
        """Return the answers to a frame."""
        return self.network.exchange(frame)

    def prepare(self) -> None:
        """Read the PDO mappings from the nodes' own objects, as an application does once."""
        for node in self.network.nodes.values():
            node.tpdo.read()

    def synchronise(self) -> int:
        """Take a SYNC; return how many PDOs were sent."""
        return len(self.network.exchange(SYNC))

    def _on_sync(self, *_: object) -> None:
        for node_id, node in self.network.nodes.items():
            pdo = node.tpdo[1]
            pdo[0].raw = 0 if node_id == 1 else 50.0
            pdo.transmit()


def upload(node_id: int, index: int, subindex: int) -> Frame:
    """Return an SDO request to read an object."""
    return Frame(0x600 + node_id, struct.pack("<BHB4x", 0x40, index, subindex))


def download(node_id: int, index: int, subindex: int, raw: bytes) -> Frame:
    """Return an SDO request to write an object of one to four bytes."""
    command = 0x23 | (4 - len(raw)) << 2
    return Frame(
        0x600 + node_id, struct.pack("<BHB", command, index, subindex) + raw.ljust(4, b"\0")
    )


def configure(node_id: int) -> list[Frame]:
    """Return the SDO requests that make TPDO1 follow each SYNC, and nothing else."""
    return [download(node_id, 0x1800, 2, b"\1"), download(node_id, 0x1800, 5, bytes(2))]


MAP_EIGHT_BYTES = (
    # RPDO1 off; control word, set-point and a dummy of 32 bit; on again.
    download(1, 0x1400, 1, bytes.fromhex("01020080")),
    download(1, 0x1600, 0, b"\0"),
    download(1, 0x1600, 3, bytes.fromhex("20000700")),
    download(1, 0x1600, 0, b"\3"),
    download(1, 0x1400, 1, bytes.fromhex("01020000")),
)


def timed(action: Callable[[], object]) -> float:
    """Return how long an action takes [s]."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def demand(expected: int, found: int, what: str) -> None:
    """End the run where something other than intended was measured.

    Raises:
        SystemExit: it was.
    """
    if expected != found:
        raise SystemExit(f"{what}: {found} where {expected} are right; nothing was measured")


class Figures(NamedTuple):
    """What was measured of one implementation; times in [s]."""

    make: float
    boot: float
    enumerate_node: float
    sync: float


def measure(make: Callable[[], "OurNodes | PeerNodes"], syncs: int) -> Figures:
    """Return the figures of 127 nodes."""
    nodes = make()
    made = timed(make)
    boot_start = time.perf_counter()
    demand(NODES, nodes.boot(), "boot-up messages")
    boot = time.perf_counter() - boot_start
    requests = [upload(n, *key) for n in range(1, NODES + 1) for key in IDENTITY]
    enumeration = timed(lambda: [demand(1, len(nodes.exchange(r)), "answers") for r in requests])
    for node_id in range(1, NODES + 1):
        for request in configure(node_id):
            demand(1, len(nodes.exchange(request)), "answers")
    if isinstance(nodes, PeerNodes):
        nodes.prepare()
    nodes.exchange(NMT_START)
    nodes.synchronise()
    durations = []
    for _ in range(syncs):
        start = time.perf_counter()
        sent = nodes.synchronise()
        durations.append(time.perf_counter() - start)
        demand(NODES, sent, "TPDOs")
    return Figures(made, boot, enumeration / NODES, statistics.median(durations))


def held(make: Callable[[], object]) -> float:
    """Return the memory that one node holds [B], as Python's allocator counts it."""
    gc.collect()
    tracemalloc.start()
    nodes = make()
    gc.collect()
    memory = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    del nodes
    return memory / NODES


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
        """Return what has arrived by now."""
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
        """Return what passed."""
        return TransportCounters(received=self._taken, sent=self._sent)

    def close(self) -> None:
        """Do nothing."""


def count_answers(frames: Sequence[Frame]) -> int:
    """Return how many of the frames are SDO answers."""
    return sum(0x580 < frame.can_id < 0x600 for frame in frames)


class Service(NamedTuple):
    """How a bus was served in real time.

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
    report = run_paced(bench, bus, pacer, stopped=lambda: pacer.statistics.ticks >= ticks)
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
    network = PeerNetwork()
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


def print_nodes(ours: Figures, peer: Figures, ticked: float) -> None:
    """Print the figures of 127 nodes."""
    rows = (
        ("make, from EDS files, a node", 1e3, "ms", "make", NODES),
        ("boot, all", 1e3, "ms", "boot", 1),
        ("enumerate, five SDO uploads, a node", 1e6, "us", "enumerate_node", 1),
        ("SYNC to 127 TPDOs", 1e3, "ms", "sync", 1),
    )
    print(f"| {NODES} nodes | {OurNodes.name} | {PeerNodes.name} | ratio |\n|---|---|---|---|")
    for what, factor, unit, field, count in rows:
        own, other = getattr(ours, field) / count * factor, getattr(peer, field) / count * factor
        print(f"| {what} | {own:.3g} {unit} | {other:.3g} {unit} | {own / other:.2f} |")
    print(f"| the same SYNC, ten ticks of 1 ms | {ticked * 1e3:.3g} ms | | |")


def print_bus(work: float, peer: float, service: Service) -> None:
    """Print the figures of a full bus."""
    ticks, traffic = service.report.ticks, service.bus.traffic
    print(f"\n| full bus, {FULL_BUS} frames/s | figure |\n|---|---|")
    print(f"| work for one second of it, four nodes and plant | {work * 1e3:.0f} ms |")
    print(f"| the same for four `{PeerNodes.name}`, no plant | {peer * 1e3:.0f} ms |")
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
    """Print the figures as Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--syncs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=7)
    args = parser.parse_args()
    print(f"{platform.machine()}, Python {platform.python_version()}; ", end="")
    print(f"the fastest of {args.repeats} rounds, in turns\n")
    makers = (partial(OurNodes, 10_000), PeerNodes, partial(OurNodes, 1000))
    rounds = [[measure(make, args.syncs) for make in makers] for _ in range(args.repeats)]
    ours, peer, ticked = (fastest(column) for column in zip(*rounds, strict=True))
    print_nodes(ours, peer, ticked.sync)
    own, other = (held(make) * 1e-3 for make in makers[:2])
    print(f"| memory, a node | {own:.3g} kB | {other:.3g} kB | {own / other:.2f} |")
    work = [(full_bus_work(10), peer_full_bus_work(10)) for _ in range(args.repeats)]
    print_bus(*map(min, zip(*work, strict=True)), serve_full_bus(args.seconds))


def fastest(rounds: Sequence[Figures]) -> Figures:
    """Return the shortest time of each kind: what other work on the machine disturbed least."""
    return Figures(*map(min, zip(*rounds, strict=True)))


if __name__ == "__main__":
    main()
