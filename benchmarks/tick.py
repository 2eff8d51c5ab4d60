"""Work per tick of the whole bench on an in-memory bus, and simulated seconds per second.

    python benchmarks/tick.py [--ticks N] [--repeats N]

A tick takes the valve's RPDO and a SYNC in, runs the plant steps and four nodes, and gives four
TPDOs out. The peers in the same run: the plant steps alone, and `hil-bench demo --speed max`,
which adds a controller on the canopen library.
"""

import argparse
import statistics
import struct
import time

import occasion
from hil_bench.abilities.demo.session import DemoSession
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.plants.hydraulic_cylinder.model import PlantInput

TICK = 1_000_000  # [ns]
STEPS = load_config().steps_per_tick
SYNC = Frame(0x080)


def prepared_bench() -> tuple[Bench, int]:
    """Return an active bench whose TPDOs follow each SYNC, and its next tick's time [ns]."""
    bench = build_bench(load_config())
    now = TICK
    bench.start(now)
    bench.tick([], now)
    for node_id in (1, 2, 3, 4):
        now += TICK
        bench.tick([Frame(0x600 + node_id, bytes.fromhex("2f00180201000000"))], now)
    now += TICK
    bench.tick([Frame(0x000, b"\x01\x00")], now)
    return bench, now


def measure_ticks(count: int) -> tuple[float, float]:
    """Return median and 99th percentile of the work in a tick [us]."""
    bench, now = prepared_bench()
    durations = []
    for number in range(count):
        setpoint = 8192 if number // 500 % 2 else -8192
        frames = [Frame(0x201, struct.pack("<Hh", 7, setpoint)), SYNC]
        now += TICK
        start = time.perf_counter_ns()
        sent = bench.tick(frames, now)
        durations.append(time.perf_counter_ns() - start)
        assert len(sent) == 4, sent  # noqa: S101 - a benchmark of something else is worth nothing
    durations.sort()
    return durations[count // 2] / 1e3, durations[count * 99 // 100] / 1e3


def measure_plant(count: int) -> float:
    """Return the median time of the plant steps of a tick [us], call included."""
    plant = prepared_bench()[0].axes[0].plant
    durations = []
    for number in range(count):
        start = time.perf_counter_ns()
        plant.step(PlantInput(6e-4 if number // 500 % 2 else -6e-4), STEPS)
        durations.append(time.perf_counter_ns() - start)
    return statistics.median(durations) / 1e3


def measure_demo(duration: float) -> float:
    """Return bench seconds per second of the demo, controller included."""
    report = DemoSession(load_config(), duration=duration, is_paced=False).run(lambda: False)
    return report.bench_time / report.wall_time


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=7)
    args = occasion.arguments(parser, ticks=200, repeats=1)
    rows = [
        (*measure_ticks(args.ticks), measure_plant(args.ticks), measure_demo(args.ticks * 1e-3))
        for _ in range(args.repeats)
    ]
    p50, p99, plant, demo = (statistics.median(column) for column in zip(*rows, strict=True))
    print(f"medians of {args.repeats}\n")
    print("| what | figure | ratio to the plant alone |\n|---|---|---|")
    print(f"| {STEPS} plant steps, one call | {plant:.2f} us | 1 |")
    print(f"| whole tick, median | {p50:.1f} us | {p50 / plant:.1f} |")
    print(f"| whole tick, 99th percentile | {p99:.1f} us | {p99 / plant:.1f} |")
    print(f"| bench alone | {1e3 / p50:.0f} times real time | |")
    print(f"| demo, with its controller on `canopen` | {demo:.0f} times real time | |")


if __name__ == "__main__":
    main()
