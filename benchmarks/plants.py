"""Cost of a tick of each kind of plant. Run: `python benchmarks/plants.py`.

Prints a Markdown table. A tick is 20 steps of 50 us, driven as an axis does; each figure is the
median of repeats in processor time, all kinds interleaved in one process.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import occasion
from hil_bench.bench.configuration import load_config

EXAMPLES = Path(__file__).parents[1] / "examples"
BENCHES = {
    "hydraulic_cylinder": EXAMPLES / "one_axis.toml",
    "hydraulic_cylinder, machines/servo.toml": EXAMPLES / "machines" / "servo.toml",
    "rotary, machines/drum.toml": EXAMPLES / "machines" / "drum.toml",
}
TICKS, REPEATS = 4000, 15


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    repeats = occasion.arguments(parser, repeats=1).repeats
    drives = {name: _make(path) for name, path in BENCHES.items()}
    times: dict[str, list[float]] = {name: [] for name in drives}
    for _ in range(repeats):
        for name, drive in drives.items():
            begin = time.process_time()
            drive()
            times[name].append((time.process_time() - begin) / TICKS * 1e6)
    medians = {name: statistics.median(each) for name, each in times.items()}
    first = next(iter(medians.values()))
    print("| plant | a tick [us] | ratio |\n|---|---|---|")
    for name, median in medians.items():
        print(f"| {name} | {median:.2f} | {median / first:.2f} |")


def _make(path: Path) -> Callable[[], None]:
    config = load_config(path)
    axis = config.axes[0]
    plant = axis.kind.build(axis, config.dt)
    steps, full = config.tick_ns // config.step_ns, config.full_scale(axis)

    def drive() -> None:
        for tick in range(TICKS):
            plant.drive(full * (0.5 if tick // 200 % 2 else -0.5), steps)

    drive()
    return drive


if __name__ == "__main__":
    main()
