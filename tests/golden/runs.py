"""Varied runs of the bench, each of which leaves files behind: ``RUNS[name](directory)``.

What drives a bench is the same everywhere: NMT start, control words up to operation, a spool
set-point that follows two sines, a SYNC a tick; in `mixed_traffic` all sorts of frames besides. All
is sent as plain frames, so that a run depends on the bench alone.
"""

import contextlib
import io
import math
import os
import random
import shutil
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import can

from hil_bench import RecordingWish, VirtualBench, load_config
from hil_bench.cli import main
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.framing import TcpFraming

EXAMPLES = Path("examples")
TICKS = 400
CONTROL_WORDS = {1: 0x01, 2: 0x03, 3: 0x07}

PLANT = """
[bench]
seed = 3

[plant.axis1]
"""

EXTENDED = (
    PLANT
    + """
stroke_mm = 400.0
friction = "lugre"
entrained_air_percent = 1.0
supply = "unit"
accumulator_volume_l = 1.0
external_leakage_a_l_min_bar = 0.002
load_spring_n_mm = 20.0
"""
)

REDUCED = (
    PLANT
    + """
model = "reduced"
spool_delay_ms = 1.2
"""
)

PLAN = """
[plan]
bench = "sheet.toml"
period_ms = 4

[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]

[communication]

[sensors]
duration_s = 0.2

[direction]
"""

DRIFT = """
[[faults]]
kind = "drift"
target = "pressure_a"
drift_bar_s = 2.0
at_s = 0.1
"""

FAULTS = """
[[faults]]
kind = "offset"
target = "pressure_a"
offset_bar = 15.0
at_s = 0.05
for_s = 0.1

[[faults]]
kind = "break_wire"
target = "pressure_b"
at_s = 0.1

[[faults]]
kind = "freeze"
target = "position"
at_s = 0.12
for_s = 0.05

[[faults]]
kind = "stick"
target = "valve"
at_s = 0.2
for_s = 0.05

[[faults]]
kind = "drop_supply"
target = "axis1"
pressure_bar = 40.0
at_s = 0.26
for_s = 0.05

[[faults]]
kind = "delay"
target = "pressure_a"
delay_ms = 3.0
at_s = 0.3
"""


def bench_of(directory: Path, text: str) -> Path:
    """Return a bench.toml of this text."""
    path = directory / "bench.toml"
    path.write_text(text)
    return path


def drive(bench: VirtualBench, rpdos: tuple[int, ...] = (0x201,)) -> None:
    """Command the valves that take their set-points with these COB-IDs on the first bus."""
    start(bench)
    for tick in range(TICKS):
        command(bench, rpdos, tick)
        bench.run(1e-3)


def start(bench: VirtualBench) -> None:
    """Start all nodes once they have booted."""
    bench.run(2e-3)
    send(bench, 0, b"\x01\x00")
    bench.run(1e-3)


def command(bench: VirtualBench, rpdos: tuple[int, ...], tick: int) -> None:
    """Send a tick's set-points and its SYNC."""
    word = CONTROL_WORDS.get(tick, 0x07)
    for can_id in rpdos:
        course = math.sin(0.031 * tick + can_id) + 0.4 * math.sin(0.173 * tick)
        send(bench, can_id, struct.pack("<Hh", word, round(9000 * course)))
    send(bench, 0x80, b"")


def send(bench: VirtualBench, can_id: int, data: bytes) -> None:
    """Send one frame of the controller."""
    bench.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def record(config: Path | None, *paths: Path, rpdos: tuple[int, ...] = (0x201,)) -> None:
    """Drive a bench and record it."""
    wish = RecordingWish(paths)
    with VirtualBench(load_config(config) if config else None, record=wish) as bench:
        drive(bench, rpdos)


def demo(directory: Path) -> None:
    """Run `hil-bench demo` on CANopen."""
    run("demo", "--speed", "max", "--duration", "2", "--output", directory)


def demo_modbus(directory: Path) -> None:
    """Run `hil-bench demo` with its sensors on Modbus."""
    options = ("--sensors", "modbus", "--speed", "max", "--duration", "2")
    run("demo", *options, "--output", directory)


def run(*arguments: object) -> None:
    """Run the command line in this process."""
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(["-q", *map(str, arguments)]) == 0


def formats(directory: Path) -> None:
    """Record the built-in bench in every format."""
    record(None, *(directory / f"bench.{suffix}" for suffix in ("mf4", "csv", "log", "asc", "blf")))


def trigger(directory: Path) -> None:
    """Record from a trigger on."""
    path = directory / "bench.csv"
    with VirtualBench(record=RecordingWish((path,), "axis1.position > 5 mm", 0.02)) as bench:
        drive(bench)


def two_axes(directory: Path) -> None:
    """Drive both axes of the example."""
    paths = directory / "bench.csv", directory / "bench.log"
    record(EXAMPLES / "two_axes.toml", *paths, rpdos=(0x201, 0x20B))


def two_buses(directory: Path) -> None:
    """Drive the example whose sensors are on a second bus."""
    record(EXAMPLES / "two_buses.toml", directory / "bench.csv", directory / "bench.log")


def real_sensors(directory: Path) -> None:
    """Drive the example with measuring chains and their noise."""
    record(EXAMPLES / "real_sensors.toml", directory / "bench.csv", directory / "bench.log")


def generic(directory: Path) -> None:
    """Let the example of a device from an EDS alone command the spool."""
    paths = directory / "bench.csv", directory / "bench.log"
    with VirtualBench(
        load_config(EXAMPLES / "vendor_io.toml"), record=RecordingWish(paths)
    ) as bench:
        start(bench)
        for tick in range(TICKS):
            opening = round(20_000 * math.sin(0.021 * tick))
            # 0x6411.01 by expedited SDO download of two bytes.
            send(bench, 0x60A, struct.pack("<BHBhH", 0x2B, 0x6411, 1, opening, 0))
            send(bench, 0x80, b"")
            bench.run(1e-3)


def imitated(directory: Path) -> None:
    """Let devices of other makers' kinds run with SYNC alone."""
    paths = directory / "bench.csv", directory / "bench.log"
    record(EXAMPLES / "imitated_devices.toml", *paths, rpdos=(0x57F,))


def faults(directory: Path) -> None:
    """Let a sequence of faults come and go."""
    record(bench_of(directory, FAULTS), directory / "bench.csv", directory / "bench.log")


def extended(directory: Path) -> None:
    """Drive a plant with extensions."""
    record(bench_of(directory, EXTENDED), directory / "bench.csv", directory / "bench.log")


def reduced(directory: Path) -> None:
    """Drive the reduced plant."""
    record(bench_of(directory, REDUCED), directory / "bench.csv", directory / "bench.log")


def mixed_traffic(directory: Path) -> None:
    """Send frames of all kinds, valid and not, between set-points."""
    draw = random.Random(12)  # noqa: S311 - reproducible on purpose
    with VirtualBench(record=directory / "bench.log") as bench:
        start(bench)
        for tick in range(3 * TICKS):
            for can_id, data in traffic(draw):
                send(bench, can_id, data)
            command(bench, (0x201,), tick % TICKS)
            bench.run(1e-3)


def traffic(draw: random.Random) -> Iterator[tuple[int, bytes]]:
    """Draw the frames that a tick has besides: SDO of all kinds, NMT, LSS, noise."""
    for _ in range(draw.choice((0, 1, 1, 3))):
        node_id = draw.randint(1, 4)
        index = draw.choice((0x1000, 0x1008, 0x1018, 0x1400, 0x1800, 0x1A00, 0x6040, 0x6300))
        command_byte = draw.choice((0x40, 0x40, 0x40, 0x2B, 0x2F, 0x60, 0x70, 0xA4, 0xA3, 0x80))
        sdo = struct.pack("<BHBI", command_byte, index, draw.randint(0, 3), draw.randint(0, 9))
        noise = draw.randbytes(draw.randint(0, 8))
        yield draw.choices(
            [
                (0x600 + node_id, sdo),
                (0x600 + node_id, noise),
                (draw.randint(0x80, 0x7FF), noise),
                (0, bytes((draw.choice((1, 2, 128, 130)), node_id))),
                (0x7E5, bytes((draw.choice((4, 0x5E, 0x46)), 0, 0, 0, 0, 0, 0, 0))),
            ],
            weights=(20, 4, 4, 1, 1),
        )[0]


def modbus(directory: Path) -> None:
    """Read and write the built-in register maps while the valve is driven over CANopen."""
    with VirtualBench(
        load_config(EXAMPLES / "modbus.toml"), record=directory / "bench.csv"
    ) as bench:
        client = ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now, timeout=0.1)
        lines = []
        start(bench)
        for tick in range(60):
            command(bench, (0x201,), tick)
            for unit in (1, 2, 30, 4):
                words = client.read_registers(unit, "input_registers", 0, 4)
                lines.append(f"{tick} {unit} {words}")
        (directory / "answers.txt").write_text("\n".join(lines))


def frame_lines(frames: Iterable[object]) -> str:
    """Return frames as text, a classical one as before there was a field for CAN FD."""
    return "\n".join(str(frame).replace(", fd=0)", ")") for frame in frames)


def lockstep_firmware(directory: Path) -> None:
    """Let the example's controller in C move the axis in lock-step over the hub."""
    from support.firmware import build_controller, run_session  # noqa: PLC0415 - of an ability

    from hil_bench.abilities.lockstep.firmware import HUB  # noqa: PLC0415 - likewise

    frames, signals = run_session(build_controller(directory), HUB, "30,-10", directory)
    for path in directory.iterdir():
        path.unlink()
    (directory / "frames.txt").write_text(frame_lines(frames))
    (directory / "signals.bin").write_bytes(signals.tobytes())


def commissioning(directory: Path) -> None:
    """Commission a virtual machine: the first steps of a plan, what they recorded and found."""
    (directory / "sheet.toml").write_text("[bench]\ntick_us = 2000\nstep_us = 200\n")
    plan = directory / "plan.toml"
    plan.write_text(PLAN)
    run("commission", plan, "--virtual", "--output", directory / "out")
    report = (directory / "out" / "report.md").read_text(encoding="utf-8")
    of_today = ("| date |", "| plan |", "| data sheet |", "| versions |")
    lines = [line for line in report.splitlines() if not line.startswith(of_today)]
    (directory / "found.txt").write_text("\n".join(lines), encoding="utf-8")
    (directory / "out" / "commissioning.mf4").rename(directory / "commissioning.mf4")
    shutil.rmtree(directory / "out")


def shadow(directory: Path) -> None:
    """Let a twin follow the recorded frames of a machine whose pressure sensor drifts."""
    log = directory / "machine.log"
    record(bench_of(directory, DRIFT), log)
    run("shadow", "--log", log, "--horizon", "0.1", "--record", directory / "residuals.csv")
    log.unlink()


def analysis(directory: Path) -> None:
    """Draw the static curves of both models, of which the table is kept."""
    run("analyse", "flow-pressure", "--output", directory)
    (directory / "flow-pressure.svg").unlink()


RUNS: dict[str, Callable[[Path], None]] = {
    run.__name__: run
    for run in (
        *(demo, demo_modbus, formats, trigger, two_axes, two_buses, real_sensors, generic),
        *(imitated, faults, extended, reduced, mixed_traffic, modbus, lockstep_firmware),
        *(commissioning, shadow, analysis),
    )
}


@contextlib.contextmanager
def at_root() -> Iterator[None]:
    """Stay at the root of the sources: recordings name the bench's file as it was given."""
    before = Path.cwd()
    os.chdir(Path(__file__).parents[2])
    try:
        yield
    finally:
        os.chdir(before)
