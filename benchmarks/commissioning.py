"""Commission virtual machines and print Markdown: faults by name, estimates against the truth.

    python benchmarks/commissioning.py
    python benchmarks/commissioning.py --channel vcan0          # two processes, lock-step on SYNC

On a bus, `hil-bench run` plays the machine, and `hil-bench commission` beside it knows the data
sheet only. Where there is no vcan: tests/socketcan/with_vcan.py python benchmarks/commissioning.py
--channel vcan0.
"""

import argparse
import json
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import occasion
from hil_bench.abilities.commissioning.plan import load_plan
from hil_bench.abilities.commissioning.session import Commissioning, commission
from hil_bench.bench.configuration import load_config
from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import Network

EXAMPLES = Path(__file__).parents[1] / "examples"
PROGRAM = (sys.executable, "-m", "hil_bench")
PLAN = EXAMPLES / "commissioning.toml"

REAL_SENSORS = (EXAMPLES / "real_sensors.toml").read_text(encoding="utf-8")
SWAPPED = REAL_SENSORS.replace("P_A", "P_?").replace("P_B", "P_A").replace("P_?", "P_B")
OIL = "[plant.axis1]\nbulk_modulus_mpa = 700\nmoving_mass_kg = 200\n"

# What the machine is, and what its data sheet says.
FAULTS = {
    "none, ideal sensors": ("", ""),
    "none, sensors with noise, lag and delay": (REAL_SENSORS, ""),
    "none, real oil": (REAL_SENSORS + OIL, OIL),
    "pressure sensors swapped": (SWAPPED, ""),
    "valve inverted": (REAL_SENSORS + '[[faults]]\nkind = "invert"\ntarget = "valve"\n', ""),
    "position sensor stuck": (
        REAL_SENSORS + '[[faults]]\nkind = "freeze"\ntarget = "position"\n',
        "",
    ),
    "wrong EDS revision": (
        REAL_SENSORS + '[nodes.position.objects]\n"0x1018.03" = 0x20001\n',
        "",
    ),
    "10 % of air, real oil": (REAL_SENSORS + OIL + "entrained_air_percent = 10\n", OIL),
    "2 cm³/min bar leak out of chamber A": (
        REAL_SENSORS + "[plant.axis1]\nexternal_leakage_a_l_min_bar = 0.002\n",
        "",
    ),
}

# What takes long enough between two processes: the sound one, and each fault once.
ON_A_BUS = (
    "none, sensors with noise, lag and delay",
    "pressure sensors swapped",
    "valve inverted",
    "position sensor stuck",
    "wrong EDS revision",
    "10 % of air, real oil",
)

# Keys of Table I and the measure that should find each.
TRUTHS = {
    "dead band": lambda p: 2 * p.beta / p.full_opening,
    "Coulomb friction": lambda p: p.F_c,
    "viscous friction": lambda p: p.sigma,
    "effective bulk modulus": lambda p: p.E * 1e-6,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=20, help="machines drawn at random (20)")
    parser.add_argument("--faults", type=int, help="faulty machines, from the first (all)")
    parser.add_argument("--channel", help="a SocketCAN interface for two processes")
    parser.add_argument(
        "--sync-period-us", type=int, default=2000, help="how far a SYNC moves them (2000)"
    )
    args = occasion.arguments(parser, machines=1, faults=1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if args.channel:
            commission_on = partial(run_processes, args.channel, args.sync_period_us)
            show_faults(folder, list(ON_A_BUS)[: args.faults], commission_on)
        else:
            show_faults(folder, list(FAULTS)[: args.faults], run_in_process)
            show_estimates(folder, args.machines)


class Outcome(NamedTuple):
    """The outcome of a commissioning.

    Attributes:
        names: the faults that it named.
        verdict: "passed" or "failed".
        bench_time: how long it took on the bench's clock [s].
    """

    names: list[str]
    verdict: str
    bench_time: float


def run(folder: Path, machine: str, sheet: str) -> Commissioning:
    """Commission one machine by the example's plan, in virtual time."""
    machine_path, sheet_path = write_files(folder, machine, sheet)
    with (
        VirtualBench(load_config(machine_path), recorded_time=1.0) as bench,
        Network(bench.bus, clock=bench.now) as network,
    ):
        bench.pump = network.pump
        return commission(network, load_config(sheet_path), load_plan(PLAN))


def run_in_process(folder: Path, machine: str, sheet: str) -> Outcome:
    """Commission one machine by the example's plan, in virtual time."""
    found = run(folder, machine, sheet)
    names = [finding.name for finding in found.findings]
    spent = sum(result.duration for result in found.results)
    return Outcome(names, "passed" if found.passed else "failed", spent)


def run_processes(
    channel: str, sync_period_us: int, folder: Path, machine: str, sheet: str
) -> Outcome:
    """Commission one machine by the example's plan, each side a process on a SocketCAN bus.

    Raises:
        SystemExit: one of them failed.
    """
    machine_path, sheet_path = write_files(folder, machine, sheet)
    bus = ["-i", "socketcan", "-c", channel, "--lockstep", "--sync-period-us", str(sync_period_us)]
    bench = subprocess.Popen(  # noqa: S603 - our own program
        [*PROGRAM, "run", machine_path, *bus], stdout=subprocess.PIPE, text=True
    )
    wait_until_on_bus(bench)
    arguments = [PLAN, sheet_path, *bus, "--yes", "--json", "--output", folder / "output"]
    told = subprocess.run(  # noqa: S603 - our own program
        [*PROGRAM, "commission", *arguments], capture_output=True, text=True, check=False
    )
    bench.send_signal(signal.SIGINT)
    summary, _ = bench.communicate(timeout=30)
    moved = re.search(r"SYNCs of .*: ([0-9.]+) s in", summary)
    if not told.stdout or moved is None:
        raise SystemExit(f"{told.stderr}{summary}")
    found = json.loads(told.stdout)
    names = [finding["name"] for finding in found["findings"]]
    return Outcome(names, found["verdict"], float(moved[1]))


def wait_until_on_bus(bench: "subprocess.Popen[str]") -> None:
    """Return once the bench has told its bus, or has ended."""
    for line in bench.stdout or ():
        if line.startswith("bus"):
            return


def write_files(folder: Path, machine: str, sheet: str) -> tuple[Path, Path]:
    """Return the files of a machine and of its data sheet."""
    paths = folder / "machine.toml", folder / "sheet.toml"
    for path, text in zip(paths, (machine, sheet), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def show_faults(
    folder: Path, chosen: Iterable[str], commission_one: Callable[[Path, str, str], Outcome]
) -> None:
    """Print what each faulty machine is found to have."""
    print("| machine | found | verdict | bench time | wall time |\n|---|---|---|---|---|")
    for name in chosen:
        machine, sheet = FAULTS[name]
        begin = time.perf_counter()
        found = commission_one(folder, machine, sheet)
        wall = time.perf_counter() - begin
        names = ", ".join(found.names) or "nothing"
        print(
            f"| {name} | {names} | {found.verdict} | {found.bench_time:.0f} s | {wall:.1f} s |",
            flush=True,
        )


def show_estimates(folder: Path, machines: int) -> None:
    """Print how far the measures are from the truth on machines drawn within 30 % of Table I."""
    generator = random.Random(1)  # noqa: S311 - no secret
    errors: dict[str, list[float]] = {name: [] for name in TRUTHS}
    for _ in range(machines):
        keys = {
            "spool_overlap_mm": 0.3,
            "bulk_modulus_mpa": 100.0,
            "coulomb_friction_n": 600.0,
            "viscous_friction_n_s_m": 2000.0,
            "moving_mass_kg": 20.0,
            "orifice_width_mm": 20.0,
        }
        drawn = {key: value * generator.uniform(0.7, 1.3) for key, value in keys.items()}
        # What weighs and is cut to measure is known; the rest the commissioning has to find.
        known = ("moving_mass_kg",)
        lines = [f"{key} = {value}" for key, value in drawn.items()]
        machine = REAL_SENSORS + "[plant.axis1]\n" + "\n".join(lines) + "\n"
        sheet = "[plant.axis1]\n" + "\n".join(f"{key} = {drawn[key]}" for key in known) + "\n"
        found = run(folder, machine, sheet)
        truth = load_config(folder / "machine.toml").axes[0].parameters
        measures = {m.name: m.value for result in found.results for m in result.measures}
        for name, of in TRUTHS.items():
            if name in measures:
                errors[name].append(abs(measures[name] / of(truth) - 1.0))
    print(f"\n| {machines} machines within 30 % | error, median | worst | found on |")
    print("|---|---|---|---|")
    for name, values in errors.items():
        print(f"| {name} | {statistics.median(values):.1%} | {max(values):.1%} | {len(values)} |")


if __name__ == "__main__":
    main()
