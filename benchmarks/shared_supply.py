"""Cost of a tick of axes on one supply, beside as many with supplies of their own.

Run: `python benchmarks/shared_supply.py`. Processor time, all variants in turns in one process.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import occasion
from hil_bench.bench.assembly import build_supplies
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.shared_supply import SharedSupply, share_unit

STEPS = 20
TICKS = 400  # up to half of them out, the rest back
REPEATS = 31
NODES = {
    f"{axis}_valve": {"profile": "valve_408", "axis": axis, "node_id": number}
    for number, axis in enumerate(("one", "two"), 1)
}
P = replace(paper_parameters(), E=1.4e9, m=200.0)


def set_points(tick: int, axes: int) -> list[float]:
    """Return the commands of the valves [m]."""
    return [(0.8e-3 if tick < TICKS // 2 else -0.8e-3) / (1 + number) for number in range(axes)]


def own_supplies(axes: int) -> Callable[[int], None]:
    """Return a callable that makes a tick of axes that have a supply unit each."""
    options = replace(PlantOptions.bench(), supply=SupplyUnit())
    plants = [FullOrderCylinder(P, options=options) for _ in range(axes)]

    def tick(number: int) -> None:
        for plant, command in zip(plants, set_points(number, axes), strict=True):
            plant.drive(command, STEPS)

    return tick


def one_supply(axes: int, exchange: int) -> Callable[[int], None]:
    """Return a callable that makes a tick of axes on one supply unit."""
    shares = [1.0 / axes] * axes
    options = [
        replace(PlantOptions.bench(), supply=share_unit(SupplyUnit(), share, P.E, P.E))
        for share in shares
    ]
    plants = [FullOrderCylinder(P, options=each) for each in options]
    supply = SharedSupply(
        SupplyUnit(), P.E, P.P_S, P.P_T, [(each, each) for each in plants], shares, exchange
    )

    def tick(number: int) -> None:
        supply.drive(set_points(number, axes), STEPS)

    return tick


def on_bench(**keys: object) -> Callable[[int], None]:
    """Return a callable that makes a tick of two axes on one supply, as a bench moves them."""
    plant = {"supply": "hpu", "bulk_modulus_mpa": 1400, "moving_mass_kg": 200}
    tables = {"supply": {"hpu": keys}, "plant": {"one": plant, "two": plant}, "nodes": NODES}
    config = load_config(tables=tables)
    (supply,) = build_supplies(config)

    def tick(number: int) -> None:
        supply.drive(set_points(number, 2), STEPS)

    return tick


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    repeats = occasion.arguments(parser, repeats=1).repeats
    for axes in (2, 4):
        variants = {"a supply unit each": own_supplies(axes)}
        if axes == len(NODES):
            variants["on a bench"] = on_bench()
            variants["on a bench, with a tank"] = on_bench(oil="HLP 46", tank_volume_l=100.0)
            rating = {"filter_rated_flow_l_min": 60.0, "filter_rated_drop_bar": 0.5}
            variants["on a bench, with a filter"] = on_bench(**rating)
        for exchange in (20, 10, 5, 1):
            name = f"one supply, exchange each {exchange * 50} us"
            variants[name] = one_supply(axes, exchange)
        found: dict[str, list[float]] = {name: [] for name in variants}
        for repeat in range(repeats + 1):
            for name, tick in variants.items():
                begin = time.process_time()
                for number in range(TICKS):
                    tick(number)
                if repeat:
                    found[name].append((time.process_time() - begin) / TICKS * 1e6)
        first = statistics.median(found["a supply unit each"])
        print(f"\n| {axes} axes | a tick [us] | ratio |\n|---|---|---|")
        for name, times in found.items():
            middle = statistics.median(times)
            print(f"| {name} | {middle:.1f} | {middle / first:.2f} |")


if __name__ == "__main__":
    main()
