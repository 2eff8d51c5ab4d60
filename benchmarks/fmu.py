"""Our own axis as an FMU, put back as a plant, beside the axis. Run: `python benchmarks/fmu.py`.

The set-points are those of the demo. Prints the largest difference and a Markdown table of the cost
of a tick of 1 ms: the median of repeats in processor time of the bench's process, in turns in it,
and the median of ticks by the clock, which holds the time of a process of the FMU's own, too.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import occasion
from hil_bench.abilities.fmu.export import export_axis
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main as hil_bench
from hil_bench.plants.plant import Plant

BENCH = """
[bench]
step_us = {step_us}
[plant.axis1]
kind = "fmu"
file = "axis.fmu"
command = "spool_setpoint"
own_process = {own_process}
outputs = {{ position = "position", speed = "speed", P_A = "P_A", P_B = "P_B" }}
[nodes.valve]
profile = "valve_408"
node_id = 1
"""
REPEATS = 7


def main() -> None:
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="of the demo that is played again"
    )
    args = occasion.arguments(parser, repeats=1, seconds=1.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config = load_config()
        axis = config.axes[0]
        export_axis(config, axis, folder / "axis.fmu")
        hil_bench(
            [
                "demo",
                "--speed",
                "max",
                "-q",
                "--duration",
                f"{args.seconds:g}",
                "--output",
                str(folder / "demo"),
            ]
        )
        shares = read_recording(folder / "demo" / "demo.csv")["axis1.spool_setpoint"].tolist()
        plants = {"the axis itself": (axis.kind.build(axis, config.dt), axis.full_scale, 20)}
        ways = ((1000, "false"), (250, "false"), (50, "false"), (1000, "true"), (50, "true"))
        for step_us, own_process in ways:
            text = BENCH.format(step_us=step_us, own_process=own_process)
            (folder / "bench.toml").write_text(text)
            back = load_config(folder / "bench.toml")
            copy = back.axes[0]
            plant = copy.kind.build(copy, back.dt)
            how = f"as an FMU, step_us = {step_us}, own_process = {own_process}"
            plants[how] = (plant, copy.full_scale, 1000 // step_us)
        _compare(plants, shares)
        _measure(plants, shares, args.repeats)


Plants = dict[str, tuple[Plant, float, int]]


def _compare(plants: Plants, shares: Sequence[float]) -> None:
    worst = dict.fromkeys(plants, 0.0)
    for share in shares:
        positions = {
            name: plant.drive(share * full, steps)[0]
            for name, (plant, full, steps) in plants.items()
        }
        first = next(iter(positions.values()))
        for name, position in positions.items():
            worst[name] = max(worst[name], abs(position - first))
    for name, difference in worst.items():
        print(f"{name}: {difference * 1e6:.2g} um over {len(shares)} ticks")


def _measure(plants: Plants, shares: Sequence[float], repeats: int) -> None:
    used: dict[str, list[float]] = {name: [] for name in plants}
    took: dict[str, list[float]] = {name: [] for name in plants}
    for _ in range(repeats):
        for name, (plant, full, steps) in plants.items():
            begin = time.process_time()
            for share in shares[:2000]:
                started = time.perf_counter()
                plant.drive(share * full, steps)
                took[name].append((time.perf_counter() - started) * 1e6)
            played = len(shares[:2000])
            used[name].append((time.process_time() - begin) / played * 1e6)
    medians = {name: statistics.median(each) for name, each in used.items()}
    first = next(iter(medians.values()))
    print("\n| plant | a tick, processor time of the bench [us] | ratio | by the clock [us] |")
    print("|---|---|---|---|")
    for name, median in medians.items():
        clock = statistics.median(took[name])
        print(f"| {name} | {median:.1f} | {median / first:.1f} | {clock:.1f} |")


if __name__ == "__main__":
    main()
