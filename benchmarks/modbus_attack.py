"""The Modbus server under attack: honest clients beside hostile ones, and what the loop feels.

    python benchmarks/modbus_attack.py [--seeds N] [--streams N] [--minutes N] [--realtime fifo]

Three parts. The first runs the simulation of tests/support/modbus_world.py in virtual time, from
many seeds. In the second a process opens connections to a bench that runs in real time, 20 at once,
every other one honest, each of its streams cut into segments at random; every response to an honest
client is checked. In the third the same goes on for minutes, in turns with an idle server, and the
lateness of the paced 1 kHz loop is taken in both. The exit code is 1 where an honest request was
not answered, or a simulated run had a fault.
"""

import argparse
import asyncio
import contextlib
import logging
import multiprocessing
import random
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import occasion
from hil_bench.abilities.doctor.machine import SilentTransport
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.server.process import ModbusProcess
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import BenchConfig, RealtimeConfig, RealtimePolicy, load_config
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import open_session
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics

AT_ONCE = 20
"""Connections at a time."""
SETTLING = 1.0
"""Time that the loop runs before the clients come [s]."""
PATIENCE = 30.0
"""Longest wait for a response [s]: far above what a busy machine takes."""
PRIORITY = 80
SEED = 1

_CONTEXT = multiprocessing.get_context("spawn")
_TABLE = "| | p50 | p99 | p99.9 | max | overruns |\n|---|---|---|---|---|---|"


@dataclass
class Tally:
    """The results of the clients.

    Attributes:
        honest: streams of honest clients.
        hostile: streams of the others.
        segments: that the honest streams were cut into.
        asked: requests of honest clients.
        answered: those that got the right response.
        wrong: what came in the place of a right response.
    """

    honest: int = 0
    hostile: int = 0
    segments: int = 0
    asked: int = 0
    answered: int = 0
    wrong: list[str] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Take in what was found in another turn."""
        self.honest += other.honest
        self.hostile += other.hostile
        self.segments += other.segments
        self.asked += other.asked
        self.answered += other.answered
        self.wrong += other.wrong


def frame(transaction: int, unit_id: int, pdu: bytes) -> bytes:
    """Return the frame of a request."""
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit_id) + pdu


def honest_request(dice: random.Random) -> tuple[int, bytes, bytes]:
    """Return a request to a sensor: unit, PDU, and how its response begins."""
    unit_id = dice.choice((2, 3))
    constant = dice.randint(1, 255)  # of the filter
    requests = (
        (bytes.fromhex("04 0000 0008"), bytes.fromhex("04 10")),
        (bytes.fromhex("03 0000 0004"), bytes.fromhex("03 08")),
        (bytes.fromhex("02 0000 0003"), bytes.fromhex("02 01")),
        (bytes.fromhex("2B 0E 01 00"), bytes.fromhex("2B 0E 01 82")),
        (struct.pack(">BHH", 6, 1, constant), struct.pack(">BHH", 6, 1, constant)),
        (struct.pack(">BHHBH", 16, 1, 1, 2, constant), struct.pack(">BHH", 16, 1, 1)),
        (struct.pack(">BHHHHBH", 23, 0, 1, 1, 1, 2, constant), bytes.fromhex("17 02")),
        (bytes.fromhex("03 0000 007E"), bytes.fromhex("83 03")),
    )
    return unit_id, *dice.choice(requests)


def cut(data: bytes, dice: random.Random) -> Iterator[bytes]:
    """Yield data in segments of random lengths."""
    longest = dice.choice((1, 5, 20, 300))
    while data:
        size = dice.randint(1, longest)
        yield data[:size]
        data = data[size:]


async def be_honest(port: int, dice: random.Random, tally: Tally) -> None:
    """Ask some requests on one connection and check the responses."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    requests = [honest_request(dice) for _ in range(dice.randint(1, 12))]
    stream = b"".join(frame(n, unit_id, pdu) for n, (unit_id, pdu, _) in enumerate(requests))
    tally.honest += 1
    tally.asked += len(requests)

    async def send() -> None:
        for segment in cut(stream, dice):
            tally.segments += 1
            writer.write(segment)
            await asyncio.sleep(dice.choice((0.0, 0.0, dice.uniform(0.0, 0.002))))
        if dice.random() < 0.3:
            writer.write_eof()

    sending = asyncio.create_task(send())
    try:
        for number, (unit_id, pdu, beginning) in enumerate(requests):
            async with asyncio.timeout(PATIENCE):
                head = await reader.readexactly(7)
                transaction, _, length, answering = struct.unpack(">HHHB", head)
                response = await reader.readexactly(length - 1)
            right = (transaction, answering) == (number, unit_id)
            if right and response.startswith(beginning):
                tally.answered += 1
            else:
                tally.wrong.append(f"{pdu.hex(' ')}: {(head + response).hex(' ')}")
    except (OSError, EOFError, TimeoutError) as error:
        tally.wrong.append(repr(error))
    finally:
        await sending
        writer.close()


def bad_stream(dice: random.Random) -> bytes:
    """Return a stream that no client should send."""
    waiting = frame(1, 2, bytes.fromhex("05 0000 0000"))  # a write, which the loop must answer
    good = frame(2, 2, bytes.fromhex("04 0000 0008"))
    return dice.choice(
        (
            waiting + b"GARBAGE",
            waiting + dice.randbytes(dice.randint(7, 60)),
            dice.randbytes(dice.randint(1, 600)),
            waiting[: dice.randrange(1, len(waiting))],
            b"\0\1\0\0\xff\xff\1" + bytes(dice.randint(0, 20_000)),
            good * 3000,  # whose responses nobody reads
            b"".join(frame(n, 2, bytes.fromhex("05 0000 0000")) for n in range(20)),
            good + b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
            b"".join(frame(n, 9, dice.randbytes(dice.randint(1, 253))) for n in range(20)),
        )
    )


async def be_hostile(port: int, dice: random.Random, tally: Tally) -> None:
    """Send something bad, in one piece or in segments, and go away in one of several manners."""
    tally.hostile += 1
    loop = asyncio.get_running_loop()
    with socket.socket() as connection, contextlib.suppress(OSError, TimeoutError):
        connection.setblocking(False)
        async with asyncio.timeout(0.5):
            await loop.sock_connect(connection, ("127.0.0.1", port))
            stream = bad_stream(dice)
            pieces = cut(stream, dice) if len(stream) < 500 else iter((stream,))
            for segment in pieces:
                await loop.sock_sendall(connection, segment)
                await asyncio.sleep(0)
            if dice.random() < 0.5:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            await asyncio.sleep(dice.uniform(0.0, 0.02))


def besiege(
    port: int,
    seed: int,
    streams: int,
    seconds: float,
    answer: Connection,
    is_over: Any,  # noqa: ANN401 - a shared truth value
) -> None:
    """Open connections until there were enough, or for some seconds; the process' whole work."""

    async def run() -> Tally:
        tally = Tally()
        numbers = iter(range(streams))
        end = time.monotonic() + seconds

        async def go_on() -> None:
            while time.monotonic() < end and (number := next(numbers, None)) is not None:
                dice = random.Random(seed * 1_000_000 + number)  # noqa: S311 - not for secrets
                act = be_hostile if number % 2 else be_honest
                await act(port, dice, tally)

        await asyncio.gather(*(go_on() for _ in range(AT_ONCE)))
        return tally

    answer.send(None)  # everything is imported
    time.sleep(SETTLING)
    tally = Tally()
    try:
        if streams:
            tally = asyncio.run(run())
        else:
            time.sleep(seconds)  # an idle turn: the same processes, and no client
    finally:
        is_over.value = 1  # the loop ends, and its process takes what is sent
    answer.send(tally)


def take_turn(
    config: BenchConfig,
    realtime: RealtimeConfig,
    statistics: TickStatistics,
    wish: tuple[int, int, float],
) -> Tally:
    """Run the bench in real time while clients come.

    Args:
        config: the bench.
        realtime: how the loop runs.
        statistics: takes its lateness.
        wish: seed, streams, seconds.

    Raises:
        SystemExit: the server has died.
    """
    warm_up(config)
    session = open_session(config)
    binding = ModbusBinding(config, session.bench)
    session.watch(ticks=binding.exchange)
    pacer = Pacer(MonotonicClock(), config.tick_ns, statistics=statistics)
    is_over = multiprocessing.RawValue("b", 0)
    ours, theirs = _CONTEXT.Pipe(duplex=False)
    with ModbusProcess(binding.plan) as server:
        clients = _CONTEXT.Process(
            target=besiege, args=(server.endpoints.port, *wish, theirs, is_over), daemon=True
        )
        clients.start()
        ours.recv()
        run_paced(
            *(session, SilentTransport(), pacer),
            stopped=lambda: bool(is_over.value),
            realtime=realtime,
        )
        tally: Tally = ours.recv()
        occasion.joined(clients, "the clients")
        if not server.alive:
            raise SystemExit("the Modbus server has died")
    return tally


def warm_up(config: BenchConfig) -> None:
    """Have the plant's kernel compiled."""
    bench = build_bench(config)
    bench.start(0)
    bench.tick((), config.tick_ns)


def simulate(seeds: int) -> bool:
    """Run the simulation and return whether all is well."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from support.modbus_world import run_seeds  # noqa: PLC0415 - beside the tests

    faults = 0
    for name, options in (
        ("clients alone", {}),
        ("more clients than slots", {"is_crowded": True}),
        ("loop stalls, server dies", {"may_stall": True, "may_die": True}),
    ):
        began = time.process_time()
        reports = run_seeds(range(seeds), **options)
        bad = {seed: report.faults for seed, report in reports.items() if report.faults}
        faults += len(bad)
        print(
            f"simulation, {name}: {seeds} seeds, "
            f"{sum(report.duration for report in reports.values()):.0f} s of virtual time in "
            f"{time.process_time() - began:.0f} s, "
            f"{sum(report.answered for report in reports.values())} honest requests answered, "
            f"{sum(report.writes for report in reports.values())} values written, "
            f"{sum(report.frames for report in reports.values())} CAN frames, "
            f"{len(bad)} seeds with faults",
            flush=True,
        )
        for seed, found in list(bad.items())[:5]:
            print(f"  seed {seed}: {found[0]}")
    return not faults


def row(name: str, statistics: TickStatistics) -> str:
    """Return the row of a condition."""
    late = statistics.lateness.summary()
    cells = [f"{value:.0f}" for value in (late.p50_us, late.p99_us, late.p999_us, late.max_us)]
    return f"| {name} | {' | '.join(cells)} | {statistics.overruns} of {statistics.ticks} |"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, help="of the simulation")
    parser.add_argument("--streams", type=int, default=1000, help="connections of the second part")
    parser.add_argument("--minutes", type=float, default=1.0, help="of the third part, both turns")
    parser.add_argument("--slice", type=float, default=10.0, help="length of a turn [s]")
    parser.add_argument("--realtime", choices=("off", "fifo"), default="off")
    arguments = occasion.arguments(parser, seeds=2, streams=20, minutes=0.02, slice=0.6)
    logging.getLogger().setLevel(logging.CRITICAL)  # the servers would name their bad clients
    realtime = RealtimeConfig(policy=RealtimePolicy(arguments.realtime), priority=PRIORITY)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text("[modbus]\nport = 0\n", encoding="ascii")
        config = load_config(path)
    is_well = simulate(arguments.seeds) if arguments.seeds else True
    tally = Tally()
    if arguments.streams:
        wish = (SEED, arguments.streams, 1e9)
        tally = take_turn(config, realtime, TickStatistics(), wish)
        print(
            f"{tally.honest} honest streams in {tally.segments} segments beside {tally.hostile} "
            f"hostile ones: {tally.answered} of {tally.asked} honest requests answered"
        )
    conditions = {"idle": TickStatistics(), "under attack": TickStatistics()}
    for number in range(max(1, round(arguments.minutes * 60 / arguments.slice / 2))):
        for name, statistics in conditions.items():
            streams = 10**9 if name == "under attack" else 0
            wish = (SEED + 1 + number, streams, arguments.slice)
            tally.add(take_turn(config, realtime, statistics, wish))
    print(f"\nturns of {arguments.slice:g} s, policy {realtime.policy}; lateness in us\n\n{_TABLE}")
    for name, statistics in conditions.items():
        print(row(name, statistics))
    print(
        f"\nin all {tally.answered} of {tally.asked} honest requests answered, {tally.hostile} ",
        end="",
    )
    print("hostile streams")
    for wrong in tally.wrong[:5]:
        print(f"  {wrong}")
    sys.exit(0 if is_well and tally.answered == tally.asked else 1)


if __name__ == "__main__":
    main()
