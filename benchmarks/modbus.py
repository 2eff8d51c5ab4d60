"""Request rate and latency of the Modbus server beside pymodbus' own, and what the loop feels.

    python benchmarks/modbus.py [--seconds N] [--rounds N] [--realtime fifo]

The paced 1 kHz loop of the whole bench runs all the time in this process, with the Modbus server in
its own. A second process asks for all input registers of the three sensors in turn, as fast as each
of 1, 8 and 64 clients gets its answers; then the same asks a server of pymodbus with the same map
in a third process. Idle, ours and theirs take turns, so that whatever else the machine does meets
all of them.
"""

import argparse
import asyncio
import logging
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

import occasion
from hil_bench.abilities.doctor.machine import SilentTransport
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.map_files import ModbusConfig
from hil_bench.abilities.modbus.protocol.register_map import Table
from hil_bench.abilities.modbus.server.process import ModbusProcess
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import BenchConfig, RealtimeConfig, RealtimePolicy, load_config
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import open_session
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics

CLIENTS = (1, 8, 64)
PRIORITY = 80
SETTLING = 1.0
"""Time that the loop runs before the load begins [s]."""

_CONTEXT = multiprocessing.get_context("spawn")


class Client(asyncio.Protocol):
    """Asks its requests in turn, each when the one before is answered."""

    def __init__(self, requests: list[bytes], latencies: list[float]) -> None:
        self._requests = requests
        self._latencies = latencies
        self._received = b""
        self._number = 0
        self.is_over = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask the first one."""
        self._transport = transport
        self._ask()

    def data_received(self, data: bytes) -> None:
        """Take an answer, and ask the next one.

        Raises:
            SystemExit: it is a refusal.
        """
        self._received += data
        if len(self._received) < 6 or len(self._received) < 6 + self._received[5]:
            return
        if self._received[7] & 0x80:
            raise SystemExit(f"refused: {self._received.hex(' ')}")
        self._latencies.append(time.perf_counter() - self._asked_at)
        self._received = b""
        if not self.is_over:
            self._ask()

    def _ask(self) -> None:
        self._number += 1
        self._asked_at = time.perf_counter()
        self._transport.write(self._requests[self._number % len(self._requests)])


def load(
    port: int,
    requests: list[bytes],
    clients: int,
    seconds: float,
    answer: Connection,
    is_over: Any,  # noqa: ANN401 - a shared truth value
) -> None:
    """Ask for some seconds and send the latencies [s]; the process' whole work."""

    async def run() -> list[float]:
        latencies: list[float] = []
        loop = asyncio.get_running_loop()
        asking = [
            (await loop.create_connection(lambda: Client(requests, latencies), "127.0.0.1", port))
            for _ in range(clients)
        ]
        latencies.clear()
        await asyncio.sleep(seconds)
        taken = list(latencies)
        for transport, client in asking:
            client.is_over = True
            transport.close()
        return taken

    answer.send(None)  # everything is imported
    time.sleep(SETTLING)
    try:
        latencies = asyncio.run(run())
    finally:
        is_over.value = 1  # the loop ends, and its process takes what is sent
    answer.send(latencies)


def serve_with_pymodbus(counts: dict[int, int], answer: Connection) -> None:
    """Serve the same input registers with pymodbus; the process' whole work."""
    logging.disable()  # it dumps frames when a client hangs up

    async def run() -> None:
        bits = [SimData(0, count=16, values=False, datatype=DataType.BITS)]
        holding = [SimData(0, count=16, values=0, datatype=DataType.REGISTERS)]
        devices = [
            SimDevice(
                id=unit_id,
                simdata=(
                    bits,
                    bits,
                    holding,
                    [SimData(0, count=count, values=1, datatype=DataType.REGISTERS)],
                ),
            )
            for unit_id, count in counts.items()
        ]
        server = ModbusTcpServer(devices, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        answer.send(server.transport.sockets[0].getsockname()[1])
        await asyncio.sleep(1e6)

    asyncio.run(run())


@contextmanager
def pymodbus_server(counts: dict[int, int]) -> Iterator[tuple[int, int]]:
    """Run pymodbus' server.

    Yields:
        Its port and its process-ID.
    """
    ours, theirs = _CONTEXT.Pipe(duplex=False)
    process = _CONTEXT.Process(target=serve_with_pymodbus, args=(counts, theirs), daemon=True)
    process.start()
    yield ours.recv(), process.pid or 0
    process.terminate()
    process.join()


@dataclass(slots=True)
class Condition:
    """The results of one condition, in all its turns.

    Attributes:
        latencies: of the requests [s].
        seconds: that were spent asking.
        processor_time: that the server took [s].
        statistics: of the loop.
    """

    latencies: list[float] = field(default_factory=list)
    seconds: float = 0.0
    processor_time: float = 0.0
    statistics: TickStatistics = field(default_factory=TickStatistics)

    def row(self, name: str) -> str:
        """Return the row of the table; a request's processor time is the server's."""
        late = self.statistics.lateness.summary()
        lateness = [late.p50_us, late.p99_us, late.p999_us, late.max_us]
        asked = ["", "", "", "", ""]
        if self.latencies:
            ordered = sorted(self.latencies)
            ranks = (ordered[int(len(ordered) * share)] * 1e6 for share in (0.5, 0.99, 0.999))
            cost = self.processor_time / len(ordered) * 1e6
            rate = len(ordered) / self.seconds
            asked = [f"{rate:.0f}", f"{cost:.0f}", *(f"{rank:.0f}" for rank in ranks)]
        overruns = f"{self.statistics.overruns} of {self.statistics.ticks}"
        cells = [name, *asked, *(f"{value:.0f}" for value in lateness), overruns]
        return f"| {' | '.join(cells)} |"


class Load:
    """A process that asks.

    Args:
        requests: in turn.
        clients: how many ask them.
        seconds: for how long.

    Attributes:
        is_over: whether it has ended, in shared memory.
        seconds: as passed in.
    """

    def __init__(self, requests: list[bytes], clients: int, seconds: float) -> None:
        self.seconds = seconds
        self.is_over = multiprocessing.RawValue("b", 0)
        self._settings = (requests, clients, seconds)

    def start(self, port: int) -> None:
        """Start it; it asks a little later."""
        self._ours, theirs = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(
            target=load, args=(port, *self._settings, theirs, self.is_over), daemon=True
        )
        self._process.start()
        self._ours.recv()

    def collect(self) -> list[float]:
        """Return the latencies [s]."""
        latencies: list[float] = self._ours.recv()
        occasion.joined(self._process, "a client")
        return latencies


def measure(
    config: BenchConfig,
    condition: Condition,
    realtime: RealtimeConfig,
    load: Load,
    peer: tuple[int, int] | None,
) -> None:
    """Take a turn: the loop, and the load beside it.

    Args:
        config: the bench.
        condition: takes what is found.
        realtime: how the loop runs.
        load: what asks.
        peer: whom it asks, port and process-ID; None for our own server.
    """
    session = open_session(config)
    binding = ModbusBinding(config, session.bench)
    session.watch(ticks=binding.exchange)
    pacer = Pacer(MonotonicClock(), config.tick_ns, statistics=condition.statistics)
    with ModbusProcess(binding.plan) as server:
        port, process_id = peer or (server.endpoints.port or 0, server.pid or 0)
        began = processor_time(process_id)
        load.start(port)
        run_paced(
            *(session, SilentTransport(), pacer),
            stopped=lambda: bool(load.is_over.value),
            realtime=realtime,
        )
        condition.latencies += load.collect()
        condition.seconds += load.seconds
        condition.processor_time += processor_time(process_id) - began


def processor_time(process_id: int) -> float:
    """Return the processor time that a process has used so far [s]."""
    fields = Path(f"/proc/{process_id}/stat").read_text(encoding="ascii").rsplit(") ")[-1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each turn")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each condition")
    parser.add_argument("--realtime", choices=("off", "fifo"), default="off")
    arguments = occasion.arguments(parser, seconds=0.3, rounds=1)
    realtime = RealtimeConfig(policy=RealtimePolicy(arguments.realtime), priority=PRIORITY)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text("[modbus]\nport = 0\nconnections = 128\n", encoding="ascii")
        config = load_config(path)
    modbus = config.of(ModbusConfig)
    assert modbus is not None  # noqa: S101 - for the type alone
    counts = {
        unit.unit_id: sum(r.count for r in unit.register_map.table(Table.INPUT_REGISTERS))
        for unit in modbus.units
    }
    requests = [
        bytes([0, 1, 0, 0, 0, 6, unit_id, 4, 0, 0, 0, count]) for unit_id, count in counts.items()
    ]
    warm_up(config)
    conditions = run_rounds(config, realtime, arguments, requests, counts)
    print(
        f"policy {realtime.policy}; {arguments.rounds} turns of {arguments.seconds:g} s each; us\n"
    )
    print(
        "| | requests/s | CPU each | p50 | p99 | p99.9 | late p50 | p99 | p99.9 | max | overruns |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name, condition in conditions.items():
        print(condition.row(name))


def warm_up(config: BenchConfig) -> None:
    """Have the plant's kernel compiled."""
    bench = build_bench(config)
    bench.start(0)
    bench.tick((), config.tick_ns)


def run_rounds(
    config: BenchConfig,
    realtime: RealtimeConfig,
    arguments: argparse.Namespace,
    requests: list[bytes],
    counts: dict[int, int],
) -> dict[str, Condition]:
    """Measure all conditions in turns; return the results by condition."""
    conditions: dict[str, Condition] = {}
    seconds = arguments.seconds
    with pymodbus_server(counts) as theirs:
        turns: list[tuple[str, int, tuple[int, int] | None]] = [("no client", 0, None)]
        for clients in CLIENTS:
            turns += [(f"hil-bench, {clients}", clients, None)]
            turns += [(f"pymodbus, {clients}", clients, theirs)]
        for _ in range(arguments.rounds):
            for name, clients, peer in turns:
                condition = conditions.setdefault(name, Condition())
                measure(config, condition, realtime, Load(requests, clients, seconds), peer)
    return conditions


if __name__ == "__main__":
    main()
