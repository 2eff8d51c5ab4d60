"""Commission virtual machines and print Markdown: faults by name, estimates against the truth.

python benchmarks/commissioning.py
"""

import argparse
import random
import statistics
import tempfile
import time
from pathlib import Path

from drivers import Network
from hil_bench.commissioning.plan import load_plan
from hil_bench.commissioning.session import Commissioning, commission
from hil_bench.config import load_config
from hil_bench.virtual_bench import VirtualBench

PLAN = Path(__file__).parents[1] / "examples" / "commissioning.toml"

NODES = """
[nodes.valve]
profile = "valve_408"
node_id = 1
[nodes.pressure_a]
profile = "pressure_404"
node_id = 2
source = "{a}"
[nodes.pressure_b]
profile = "pressure_404"
node_id = 3
source = "{b}"
[nodes.position]
profile = "encoder_406"
node_id = 4
"""
SENSORS = """
[nodes.pressure_a.chain]
preset = "class_0.25_250_bar"
[nodes.pressure_b.chain]
preset = "class_0.25_250_bar"
[nodes.position.chain]
preset = "magnetostrictive_1_um"
"""
STRAIGHT = NODES.format(a="P_A", b="P_B")
OIL = "[plant.axis1]\nbulk_modulus_mpa = 700\nmoving_mass_kg = 200\n"

# What the machine is, what its data sheet says, and what is done to its valve.
FAULTS = {
    "none, ideal sensors": (STRAIGHT, "", 1.0),
    "none, sensors with noise, lag and delay": (STRAIGHT + SENSORS, "", 1.0),
    "none, real oil": (STRAIGHT + SENSORS + OIL, OIL, 1.0),
    "pressure sensors swapped": (NODES.format(a="P_B", b="P_A") + SENSORS, "", 1.0),
    "valve inverted": (STRAIGHT + SENSORS, "", -1.0),
    "position sensor stuck": (
        STRAIGHT + SENSORS + '[[faults]]\nkind = "freeze"\ntarget = "position"\nat_s = 0\n',
        "",
        1.0,
    ),
    "wrong EDS revision": (
        STRAIGHT + '[nodes.position.objects]\n"0x1018.03" = 0x20001\n' + SENSORS,
        "",
        1.0,
    ),
    "10 % of air, real oil": (
        STRAIGHT + SENSORS + OIL + "entrained_air_percent = 10\n",
        OIL,
        1.0,
    ),
    "2 cm³/min bar leak out of chamber A": (
        STRAIGHT + SENSORS + "[plant.axis1]\nexternal_leakage_a_l_min_bar = 0.002\n",
        "",
        1.0,
    ),
}

# Keys of Table I and the measure that should find each.
TRUTHS = {
    "dead band": lambda p: 2 * p.beta / p.full_opening,
    "Coulomb friction": lambda p: p.F_c,
    "viscous friction": lambda p: p.sigma,
    "effective bulk modulus": lambda p: p.E * 1e-6,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=20, help="machines drawn at random (20)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        show_faults(Path(folder))
        show_estimates(Path(folder), args.machines)


def run(folder: Path, machine: str, sheet: str, polarity: float = 1.0) -> Commissioning:
    """Commission one machine by the example's plan, in virtual time."""
    (folder / "machine.toml").write_text(machine)
    (folder / "sheet.toml").write_text(sheet)
    with (
        VirtualBench(load_config(folder / "machine.toml"), recorded_time=1.0) as bench,
        Network(bench.bus, clock=bench.now) as network,
    ):
        bench.pump = network.pump
        valve = bench.bench.axes[0].valve
        command = valve.command
        valve.command = lambda now: polarity * command(now)  # type: ignore[method-assign]
        return commission(network, load_config(folder / "sheet.toml"), load_plan(PLAN))


def show_faults(folder: Path) -> None:
    """Print what each faulty machine is found to have."""
    print("| machine | found | verdict | bench time | wall time |\n|---|---|---|---|---|")
    for name, (machine, sheet, polarity) in FAULTS.items():
        begin = time.perf_counter()
        found = run(folder, machine, sheet, polarity)
        wall = time.perf_counter() - begin
        names = ", ".join(finding.name for finding in found.findings) or "nothing"
        verdict = "passed" if found.passed else "failed"
        spent = sum(result.duration for result in found.results)
        print(f"| {name} | {names} | {verdict} | {spent:.0f} s | {wall:.1f} s |")


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
        machine = STRAIGHT + SENSORS + "[plant.axis1]\n" + "\n".join(lines) + "\n"
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
