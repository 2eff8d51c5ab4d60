"""127 nodes on one bus in one process.

    python benchmarks/nodes.py [--syncs N] [--repeats N]

The peer in the same run is `canopen.LocalNode` of the canopen library, from the same EDS files. It
sends no PDO by itself and takes none into its objects, so what an application does there is written
here for it: set the process value, transmit the TPDO on SYNC. Its frames go to a list, as ours do;
neither side has a real bus, a thread or a lock in its way. What counts is processor time.
"""

import argparse
import gc
import statistics
import time
import tracemalloc
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import canopen

import occasion
from device_profiles import PRESSURE_404, VALVE_408
from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from master import NMT_START, SYNC, demand, download, upload
from peers import CanopenNetwork, Sent

NODES = 127
IDENTITY = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4))
"""What an enumeration reads of each node."""

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
        self._session = Session(self.bench)
        self._lockstep = LockStep(self._session, tick_ns=config.tick_ns)
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
            self._session.now += 10_000_000 // self._ticks
            sent += len(self.bench.tick((), self._session.now))
        return sent


class PeerNodes:
    """The same nodes as `canopen.LocalNode`."""

    name = "canopen.LocalNode"

    def __init__(self) -> None:
        self.network = CanopenNetwork()
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
        return sum(bytes(data) == b"\x00" for _, data in self.network.sent)

    def exchange(self, frame: Frame) -> Sent:
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


def configure(node_id: int) -> list[Frame]:
    """Return the SDO requests that make TPDO1 follow each SYNC, and nothing else."""
    return [download(node_id, 0x1800, 2, b"\1"), download(node_id, 0x1800, 5, bytes(2))]


def timed(action: Callable[[], object]) -> float:
    """Return the processor time that an action takes [s]."""
    start = time.thread_time()
    action()
    return time.thread_time() - start


class Figures(NamedTuple):
    """The figures of one implementation; times in [s]."""

    make: float
    boot: float
    enumerate_node: float
    sync: float


def measure(make: Callable[[], "OurNodes | PeerNodes"], syncs: int) -> Figures:
    """Return the figures of 127 nodes."""
    nodes = make()
    made = timed(make)
    boot_start = time.thread_time()
    demand(NODES, nodes.boot(), "boot-up messages")
    boot = time.thread_time() - boot_start
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
        start = time.thread_time()
        sent = nodes.synchronise()
        durations.append(time.thread_time() - start)
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


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--syncs", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    args = occasion.arguments(parser, syncs=2, repeats=1)
    print(f"the fastest of {args.repeats} rounds, in turns\n")
    makers = (partial(OurNodes, 10_000), PeerNodes, partial(OurNodes, 1000))
    rounds = [[measure(make, args.syncs) for make in makers] for _ in range(args.repeats)]
    ours, peer, ticked = (fastest(column) for column in zip(*rounds, strict=True))
    print_nodes(ours, peer, ticked.sync)
    own, other = (held(make) * 1e-3 for make in makers[:2])
    print(f"| memory, a node | {own:.3g} kB | {other:.3g} kB | {own / other:.2f} |")


def fastest(rounds: Sequence[Figures]) -> Figures:
    """Return the shortest time of each kind: what other work on the machine disturbed least."""
    return Figures(*map(min, zip(*rounds, strict=True)))


if __name__ == "__main__":
    main()
