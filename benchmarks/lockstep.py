"""Simulated seconds per second in lock-step: in this process, and over the hub.

    python benchmarks/lockstep.py [--seconds S] [--repeats N] [--beside PYTHON]

In each cycle of 1 ms of bench time every valve gets its RPDO, SYNC follows, and every node answers
with its TPDO. In this process the cycle is calls, and the seconds are those of the processor; over
the hub another process sends the frames over TCP and waits for all answers, and the seconds are
those of the clock. Best of some repeats, since other programs only make it slower.

With `--beside`, the rows in process are measured here and in another environment, such as one with
a compiled core, in turns: each turn is a new process.
"""

import argparse
import json
import multiprocessing
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import occasion
from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.lockstep.lockstep import LockStep, run_lockstep
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.compiled import look_at_core
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame

ROOT = Path(__file__).parents[1]
SYNC = Frame(0x080)


def valves_of(config: BenchConfig) -> list[int]:
    """Return the node-IDs of the valves."""
    return [node.node_id for node in config.nodes if node.kind.is_drive]


def set_up_frames(config: BenchConfig) -> Iterator[Frame]:
    """Yield what has every node answer each SYNC and no timer, and brings all to OPERATIONAL."""
    for node in config.nodes:
        yield Frame(0x600 + node.node_id, bytes.fromhex("2f00180201000000"))  # 0x1800.02 = 1
        yield Frame(0x600 + node.node_id, bytes.fromhex("2b00180500000000"))  # 0x1800.05 = 0
    yield Frame(0x000, b"\x01\x00")


def cycle_frames(valves: Sequence[int], number: int) -> list[Frame]:
    """Return the frames of one cycle: a set-point that goes to and fro, and SYNC."""
    setpoint = 8192 if number // 500 % 2 else -8192
    data = struct.pack("<Hh", 7, setpoint)
    return [*(Frame(0x200 + node_id, data) for node_id in valves), SYNC]


def start_lockstep(config: BenchConfig) -> LockStep:
    """Return a powered-on bench."""
    session = open_session(config)
    session.start()
    session.tick([], 0)
    return LockStep(session, tick_ns=config.tick_ns)


def measure_plants(config: BenchConfig, cycles: int) -> float:
    """Return seconds of bench time per second of the processor for the plants alone."""
    bench = build_bench(config)
    plants = [bench.axes[number].plant for number in bench.single]
    started = time.process_time()
    for number in range(cycles):
        command = 6e-4 if number // 500 % 2 else -6e-4
        for plant in plants:
            plant.drive(command, config.steps_per_tick)
        for axes, group in bench.groups:
            group.drive([command] * len(axes), config.steps_per_tick)
    return cycles * config.tick_ns * 1e-9 / (time.process_time() - started)


def measure_in_process(config: BenchConfig, cycles: int) -> float:
    """Return seconds of bench time per second of the processor, frames in and out included."""
    lockstep = start_lockstep(config)
    for frame in set_up_frames(config):
        lockstep.receive(frame)
    valves = valves_of(config)
    script = [cycle_frames(valves, number) for number in range(cycles)]
    answers = 0
    started = time.process_time()
    for frames in script:
        for frame in frames:
            answers += len(lockstep.receive(frame))
    elapsed = time.process_time() - started
    assert answers >= cycles * len(config.nodes), answers  # noqa: S101 - or it measured nothing
    return cycles * config.tick_ns * 1e-9 / elapsed


def command_text(frames: Sequence[Frame]) -> bytes:
    """Return "send" commands of the socketcand protocol."""
    return b"".join(
        b"< send %03X %d %b >" % (frame.can_id, len(frame.data), frame.data.hex(" ").encode())
        for frame in frames
    )


def control(port: int, path: Path | None, cycles: int) -> None:
    """Be the controller: send each cycle's frames and wait for as many as answer them."""
    config = load_config(path)
    with socket.create_connection(("127.0.0.1", port)) as bus:
        bus.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for command in (b"< open can0 >", b"< rawmode >", command_text([*set_up_frames(config)])):
            bus.recv(100)
            bus.sendall(command)
        hear(bus, 2 * len(config.nodes))
        valves = valves_of(config)
        texts = [command_text(cycle_frames(valves, number)) for number in (0, 500)]
        for number in range(cycles):
            bus.sendall(texts[number // 500 % 2])
            hear(bus, len(config.nodes))


def hear(bus: socket.socket, count: int) -> None:
    """Wait for as many messages."""
    while count > 0:
        count -= bus.recv(65_536).count(b">")


def measure_over_hub(config: BenchConfig, cycles: int) -> float:
    """Return seconds of bench time per second, the controller in a process of its own."""
    hub = HostedBus()
    arguments = hub.port, config.path, cycles
    controller = multiprocessing.get_context("spawn").Process(target=control, args=arguments)
    controller.start()
    lockstep = start_lockstep(config)
    report = run_lockstep(lockstep, hub, stopped=lambda: lockstep.syncs >= cycles)
    occasion.joined(controller, "the controller on the hub")
    hub.close()
    return (report.now - config.tick_ns) * 1e-9 / report.moved


def measure_firmware(config: BenchConfig, count: int) -> float:
    """Return seconds of bench time per second with the controller in C of examples/firmware."""
    with tempfile.TemporaryDirectory() as build:
        make = ["make", "--silent", "-C", ROOT / "examples" / "firmware", f"BUILD={build}"]
        subprocess.run(make, check=True)  # noqa: S603 - our own Makefile
        hub = HostedBus()
        targets = ",".join(["60", "-60"][number % 2] for number in range(count))
        bus = ["--bus", f"127.0.0.1:{hub.port}", "--lockstep"]
        command = [f"{build}/position_control", *bus, "--targets-mm", targets]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as controller:  # noqa: S603
            lockstep = start_lockstep(config)
            report = run_lockstep(lockstep, hub, stopped=lambda: controller.poll() is not None)
        hub.close()
    return report.now * 1e-9 / report.moved


def config_of(axes: int) -> BenchConfig:
    """Return a bench of as many axes, four nodes each."""
    lines = []
    for number in range(axes):
        lines.append(f"[plant.axis{number}]")
        for offset, (profile, extra) in enumerate(
            (
                ("valve_408", ""),
                ("pressure_404", 'source = "P_A"'),
                ("pressure_404", 'source = "P_B"'),
                ("encoder_406", ""),
            ),
            start=1,
        ):
            node_id = 4 * number + offset
            lines += [
                *(f"[nodes.node{node_id}]", f'profile = "{profile}"', f"node_id = {node_id}"),
                *(f'axis = "axis{number}"', extra),
            ]
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "bench.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        return load_config(path)


def print_axes(cycles: int, repeats: int) -> None:
    """Print how many axes one core holds at 1 kHz."""
    print("\n| axes | nodes | work a tick, us | share of 1 ms |\n|---|---|---|---|")
    for axes in (1, 2, 4, 8, 16, 24, 31):
        config = config_of(axes)
        speed = max(measure_in_process(config, cycles) for _ in range(repeats))
        print(f"| {axes} | {4 * axes} | {1000 / speed:.0f} | {100 / speed:.0f} % |", flush=True)


BENCHES = ("4 nodes, 1 axis", "64 nodes, 16 axes", "96 nodes, 24 axes")


def take_turn(cycles: int) -> dict[str, float | str]:
    """Measure this environment in process, by a row's name; add the state of its core."""
    configs = load_config(), load_config(ROOT / "examples" / "sixteen_axes.toml"), config_of(24)
    found: dict[str, float | str] = {"core": str(look_at_core())}
    for bench, config in zip(BENCHES, configs, strict=True):
        count = cycles * 4 // len(config.nodes)
        found[f"plants alone, {bench}"] = measure_plants(config, count)
        found[f"frames in and out, {bench}"] = measure_in_process(config, count)
    return found


def print_beside(other: str, seconds: float, repeats: int) -> None:
    """Print the rows in process, here and in another environment."""
    turns: dict[str, list[dict[str, float | str]]] = {sys.executable: [], other: []}
    for _ in range(repeats):
        for program, taken in turns.items():
            command = [program, __file__, "--turn", "--seconds", str(seconds)]
            done = subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - ourselves
            taken.append(json.loads(done.stdout))
    here, there = turns.values()
    print(f"here: {here[0]['core']}; there: {there[0]['core']}\n")
    print("| times real time | here | there | there / here |\n|---|---|---|---|")
    for name in list(here[0])[1:]:
        one, two = (max(float(turn[name]) for turn in taken) for taken in (here, there))
        print(f"| {name} | {one:.1f} | {two:.1f} | {two / one:.2f} |")


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of bench time, each repeat")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--beside", metavar="PYTHON", help="of another environment")
    parser.add_argument("--turn", action="store_true", help=argparse.SUPPRESS)
    args = occasion.quiet_arguments(parser, seconds=0.1, repeats=1)
    cycles = round(args.seconds * 1000)
    if args.turn:
        print(json.dumps(take_turn(cycles)))
        return
    occasion.print_occasion(args)
    if args.beside:
        print_beside(args.beside, args.seconds, args.repeats)
        return
    four, many = load_config(), load_config(ROOT / "examples" / "sixteen_axes.toml")
    rows = [
        ("plants alone, in process", measure_plants),
        ("frames in and out, in process", measure_in_process),
        ("over the hub, controller in another process", measure_over_hub),
    ]
    print(f"best of {args.repeats}\n")
    print("| | 4 nodes, 1 axis | 64 nodes, 16 axes |\n|---|---|---|")
    for name, measure in rows:
        best = [
            max(measure(config, count) for _ in range(args.repeats))
            for config, count in ((four, cycles), (many, cycles // 5))
        ]
        print(f"| {name} | {best[0]:.1f} | {best[1]:.1f} |", flush=True)
    if not (shutil.which("make") and shutil.which("cc")):
        occasion.missing("examples/firmware", "it needs make and a C compiler")
    targets = 1 if args.brief else 14
    best_firmware = max(measure_firmware(four, targets) for _ in range(args.repeats))
    print(f"| over the hub, examples/firmware | {best_firmware:.1f} | |")
    print_axes(cycles // 10, args.repeats)


if __name__ == "__main__":
    main()
