"""SDO round trip and SYNC to TPDO, against the same device on `canopen.LocalNode` in the same run.

    python benchmarks/latency.py [--count N] [--rounds N] [--realtime fifo]
    python tests/socketcan/with_vcan.py python benchmarks/latency.py --channel vcan0

The devices run in a process of their own, in turns, on one bus: a hub of the socketcand protocol,
or a SocketCAN interface. The client sends its next frame up to 1 ms after the last answer, at
random, so that it falls anywhere between two ticks. `canopen.LocalNode` does nothing on SYNC by
itself: as its users do, the peer sends its TPDO in a callback of 0x080.
"""

import argparse
import contextlib
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import canopen

import occasion
from device_profiles import VALVE_408
from hil_bench.abilities.hub.process import HubProcess

NODE_ID = 1
START = can.Message(arbitration_id=0x000, data=[1, NODE_ID], is_extended_id=False)
SYNC = can.Message(arbitration_id=0x080, is_extended_id=False)
READ = bytes.fromhex("4000100000000000")  # 0x1000.00, the device type
ON_EACH_SYNC = bytes.fromhex("2f00180201000000")  # 0x1800.02 = 1
PATIENCE = 30.0  # [s]

Samples = list[float]


def exchange(bus: can.BusABC, message: can.Message, answer_id: int) -> float:
    """Return the time from sending a message to its answer [us].

    Raises:
        SystemExit: there is no answer.
    """
    while bus.recv(0) is not None:
        pass
    start = time.perf_counter()
    bus.send(message)
    while time.perf_counter() - start < 1.0:
        answer = bus.recv(1.0)
        if answer is not None and answer.arbitration_id == answer_id:
            return (time.perf_counter() - start) * 1e6
    raise SystemExit(f"no answer 0x{answer_id:03X} to {message}")


def request(data: bytes) -> can.Message:
    """Return an SDO request."""
    return can.Message(arbitration_id=0x600 + NODE_ID, data=data, is_extended_id=False)


def measure(bus: can.BusABC, count: int, rng: random.Random) -> tuple[Samples, Samples]:
    """Return SDO round trips and SYNC-to-TPDO times [us] of the device on the bus."""
    await_device(bus)
    exchange(bus, request(ON_EACH_SYNC), 0x580 + NODE_ID)
    sdo = repeat(lambda: exchange(bus, request(READ), 0x580 + NODE_ID), count, rng)
    bus.send(START)
    time.sleep(0.1)
    return sdo, repeat(lambda: exchange(bus, SYNC, 0x180 + NODE_ID), count, rng)


def repeat(once: Callable[[], float], count: int, rng: random.Random) -> Samples:
    """Return many measurements, each begun at a random time after the one before."""
    samples = []
    for _ in range(count):
        time.sleep(rng.uniform(0.0, 1e-3))
        samples.append(once())
    return samples


def await_device(bus: can.BusABC) -> None:
    """Wait until the device answers.

    Raises:
        SystemExit: it does not.
    """
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        bus.send(request(READ))
        answer = bus.recv(0.2)
        if answer is not None and answer.arbitration_id == 0x580 + NODE_ID:
            return
    raise SystemExit("the device does not answer")


def run_peer(arguments: argparse.Namespace) -> None:
    """Be the same device on `canopen.LocalNode`, until the process is ended."""
    network = canopen.Network(open_bus(arguments))
    network.connect()
    node = network.create_node(NODE_ID, str(VALVE_408))
    node.tpdo[1].read(from_od=True)
    node.tpdo[1].cob_id = 0x180 + NODE_ID
    network.subscribe(0x080, lambda *_: node.tpdo[1].transmit())
    node.nmt.send_command(0)
    threading.Event().wait()


def open_bus(arguments: argparse.Namespace) -> can.BusABC:
    """Open the client's or the peer's end of the bus."""
    if arguments.channel:
        return can.Bus(interface="socketcan", channel=arguments.channel)
    return can.Bus(
        interface="socketcand", channel="can0", host="127.0.0.1", port=arguments.port, tcp_tune=True
    )


@contextlib.contextmanager
def device(command: list[str]) -> Iterator[None]:
    """Run a device in a process of its own."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def devices(arguments: argparse.Namespace, folder: Path) -> dict[str, list[str]]:
    """Return the command that runs each device."""
    bus = ["-i", "socketcan", "-c", arguments.channel]
    peer = ["--channel", arguments.channel]
    if not arguments.channel:
        address = ["--bus-kwargs", "host=127.0.0.1", f"port={arguments.port}"]
        bus, peer = ["-i", "socketcand", "-c", "can0", *address], ["--port", str(arguments.port)]
    commands = {}
    for tick_us in (1000, 250):
        config = folder / f"tick_{tick_us}.toml"
        config.write_text(f"[bench]\ntick_us = {tick_us}\n")
        run = [sys.executable, "-m", "hil_bench", "--quiet", "run", str(config), *bus]
        commands[f"hil-bench, a tick each {tick_us} us"] = [
            *run,
            *(("--realtime", arguments.realtime) if arguments.realtime else ()),
        ]
    commands["canopen.LocalNode"] = [sys.executable, __file__, "--peer", *peer]
    return commands


def percentile(samples: Samples, share: float) -> float:
    """Return a percentile, nearest rank."""
    return sorted(samples)[min(int(share * len(samples)), len(samples) - 1)]


def print_table(title: str, results: dict[str, Samples]) -> None:
    """Print one table."""
    peer = percentile(results["canopen.LocalNode"], 0.5)
    print(f"\n| {title} [us] | p50 | p99 | max | p50 over the peer's |\n|---|---|---|---|---|")
    for name, samples in results.items():
        p50, p99 = percentile(samples, 0.5), percentile(samples, 0.99)
        print(f"| {name} | {p50:.0f} | {p99:.0f} | {max(samples):.0f} | {p50 / peer:.2f} |")


def main() -> None:
    """Print the figures as Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="of each kind, in each round")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each device")
    parser.add_argument("--channel", default="", help="a SocketCAN interface in place of the hub")
    parser.add_argument("--realtime", choices=("fifo", "deadline"))
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--peer", action="store_true", help=argparse.SUPPRESS)
    arguments = occasion.quiet_arguments(parser, count=5, rounds=1)
    if arguments.peer:
        run_peer(arguments)
        return
    occasion.print_occasion(arguments)
    with contextlib.ExitStack() as stack:
        if not arguments.channel:
            arguments.port = stack.enter_context(HubProcess(port=0)).port
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        commands = devices(arguments, folder)
        sdo: dict[str, Samples] = {name: [] for name in commands}
        sync: dict[str, Samples] = {name: [] for name in commands}
        rng = random.Random(1)  # noqa: S311 - no secret
        for _ in range(arguments.rounds):
            for name, command in commands.items():
                with open_bus(arguments) as bus, device(command):
                    round_trips, latencies = measure(bus, arguments.count, rng)
                sdo[name] += round_trips
                sync[name] += latencies
    bus_name = f"SocketCAN {arguments.channel}" if arguments.channel else "the hub, loopback TCP"
    print(f"{bus_name}, {arguments.rounds} x {arguments.count} each")
    print_table("SDO round trip", sdo)
    print_table("SYNC to TPDO", sync)


if __name__ == "__main__":
    main()
