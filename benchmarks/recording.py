"""Measure the recorder and print Markdown: cost to the loop, loss after SIGKILL, size of an hour.

python benchmarks/recording.py
"""

import argparse
import os
import random
import signal
import statistics
import tempfile
import time
from pathlib import Path

import occasion
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.recorder import RecordingPlan
from hil_bench.abilities.recording.recorder_process import RecorderProcess
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import sample
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel

CHANNELS = tuple(Channel(f"signal{number}", "m") for number in range(16))
PERIOD = 1e-3


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="recorders to kill (20)")
    parser.add_argument("--ticks", type=int, default=3000, help="of the cost (3000)")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the sizes' runs")
    args = occasion.arguments(parser, kills=1, seconds=0.2, ticks=100)
    with tempfile.TemporaryDirectory() as folder:
        print("| measure | value |\n|---|---|")
        measure_cost(Path(folder), args.ticks)
        measure_loss(Path(folder), args.kills)
        measure_size(Path(folder), args.seconds)


def plan(*paths: Path) -> RecordingPlan:
    """Return a plan of 16 signals."""
    return RecordingPlan(paths, CHANNELS)


def frames(tick: int) -> list[Frame]:
    """Return the frames of a bench of one axis in a tick: four TPDOs."""
    data = tick.to_bytes(8, "little")
    return [Frame(0x181 + node, data) for node in range(4)]


def pace(recorder: RecorderProcess, duration: float, row: list[float]) -> None:
    """Record at 1 kHz; the time of a row is the machine's clock."""
    start = time.monotonic()
    for tick in range(round(duration / PERIOD)):
        now = time.monotonic()
        row[0] = now
        recorder.append_frames(frames(tick), round(now * 1e9), is_received=False)
        recorder.append_row(row)
        time.sleep(max(0.0, start + (tick + 1) * PERIOD - time.monotonic()))


def measure_cost(folder: Path, ticks: int) -> None:
    """Print what a tick costs the loop, with the recorder's process at work."""
    row = [0.5] * (1 + len(CHANNELS))
    rows, both, four = [], [], frames(1)
    with RecorderProcess(plan(folder / "cost.mf4")) as recorder:
        for _ in range(ticks):
            begin = time.perf_counter_ns()
            recorder.append_row(row)
            middle = time.perf_counter_ns()
            recorder.append_frames(four, 1, is_received=False)
            recorder.append_frames((), 1, is_received=True)
            rows.append(middle - begin)
            both.append(time.perf_counter_ns() - begin)
            time.sleep(PERIOD)
    bench = build_bench(load_config())
    begin = time.perf_counter_ns()
    for _ in range(10_000):
        sample(bench)
    sampling = (time.perf_counter_ns() - begin) / 10_000
    print(f"| row of 16 signals, median, p99 | {_percentiles(rows)} |")
    print(f"| row and four frames, median, p99 | {_percentiles(both)} |")
    print(f"| taking the values of one axis | {sampling / 1e3:.1f} us |")


def _percentiles(times: list[int]) -> str:
    ordered = sorted(times)
    p99 = ordered[len(ordered) * 99 // 100]
    return f"{statistics.median(ordered) / 1e3:.1f} us, {p99 / 1e3:.1f} us"


def measure_loss(folder: Path, kills: int) -> None:
    """Print how much is missing after SIGKILL at random moments."""
    losses, moments = [], random.Random(1)  # noqa: S311 - no secret
    for seed in range(kills):
        path, log = folder / f"loss{seed}.mf4", folder / f"loss{seed}.log"
        with RecorderProcess(plan(path, log)) as recorder:
            pace(recorder, 0.6 + moments.random(), [0.0] * 17)
            killed = time.monotonic()
            os.kill(recorder.pid, signal.SIGKILL)
        last_row = read_recording(path)["time"][-1]
        last_frame = list(read_frames(log))[-1].now * 1e-9
        losses.append(killed - min(last_row, last_frame))
    print(
        f"| lost after SIGKILL, {kills} times: median, worst | {statistics.median(losses):.2f} s, "
        f"{max(losses):.2f} s |"
    )


def measure_size(folder: Path, duration: float) -> None:
    """Print the size of an hour at 1 kHz: 16 signals that move, four frames a tick."""
    generator = random.Random(1)  # noqa: S311 - no secret
    row = [0.0] * 17
    paths = [folder / f"size{suffix}" for suffix in (".mf4", ".csv", ".blf", ".asc", ".log")]
    with RecorderProcess(plan(*paths)) as recorder:
        for tick in range(round(duration / PERIOD)):
            row[0] = tick * PERIOD
            for number in range(1, 17):
                row[number] += generator.gauss(0.0, 1e-3)
            recorder.append_frames(frames(tick), tick * 1_000_000, is_received=False)
            recorder.append_row(row)
            time.sleep(PERIOD / 4)
    for path in paths:
        size = path.stat().st_size / duration * 3600 / 1e6
        print(f"| {path.suffix}, MB an hour | {size:.0f} |")


if __name__ == "__main__":
    main()
