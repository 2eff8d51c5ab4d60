"""The next manoeuvre: are the intervals that `identify --design` foresees those that come?

Run: `python benchmarks/next_manoeuvre.py [MACHINES]`.

The design knows Table I, the speed limit of 400 mm/s and +-150 mm, and has 20 s. It is played on
machines whose parameters are within 30 % of Table I, with end stops and the sensors' noise; the fit
starts at Table I. Prints a Markdown table of the standard deviations, achieved by foreseen.
"""

import argparse
import math
import sys
import time
from dataclasses import replace

import numpy as np
from hil_bench.abilities.identification.unknowns import KINDS, Unknowns

import occasion
from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.choosing import Designer
from hil_bench.abilities.identification.design.foresight import Foresight
from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.identify import identify
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.configuration import require_cylinder
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

NOISE = np.array([2e-6, 5e3, 5e3])  # [m], [Pa]
LIMITS = Limits(position=(-0.15, 0.15), speed=0.4, pressure=(-1e5, 1.1e7), time=60.0)


def main() -> None:
    """Design once, identify machines, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("machines", type=int, nargs="?", default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the manoeuvre (20)")
    parser.add_argument("--sought", nargs="+", choices=KINDS, default=tuple(KINDS))
    parser.add_argument("--starts", type=int, default=24, help="candidates of the search (24)")
    args = occasion.arguments(parser, machines=1, seconds=8.0, sought=["E"], starts=1)
    axis = require_cylinder(load_config(None).first_axis, "this benchmark")
    known = paper_parameters()
    twin = Twin(
        axis="axis1",
        parameters=known,
        options=axis.options,
        step=5e-5,
        interval=1e-3,
        full_opening=known.full_opening,
        noise=NOISE,
        has_spool=False,
    )
    start = time.process_time()
    foresight = Foresight(twin, Unknowns(known, tuple(args.sought)))
    design = Designer(foresight, Bounds.of(axis, LIMITS)).design(args.seconds)
    print(f"design: {time.process_time() - start:.0f} s of processor time", file=sys.stderr)
    ratios: dict[str, list[float]] = {name: [] for name in args.sought}
    hits = dict.fromkeys(args.sought, 0)
    for number in range(args.machines):
        source = np.random.default_rng(100 + number)
        values = {name: getattr(known, name) * source.uniform(0.7, 1.3) for name in KINDS}
        values["F_s"] = max(values["F_s"], 1.1 * values["F_c"])
        values["C_L"] = source.uniform(0.0, 2e-13)
        machine = replace(known, **{name: values[name] for name in args.sought})
        real = replace(twin, parameters=machine)
        record = real.record(design.setpoints, real.run(design.setpoints, design.start))
        noise = NOISE * source.standard_normal(record.measured.shape)
        found = identify(
            replace(record, measured=record.measured + noise),
            *(known, axis.options),
            step=5e-5,
            names=args.sought,
            starts=args.starts,
        )
        after = {one.name: one.after for one in design.outlooks}
        for one in found.told:
            true = getattr(machine, one.name)
            ratios[one.name].append(one.deviation / after[one.name])
            hits[one.name] += one.interval[0] <= true <= one.interval[1]
        print(f"machine {number + 1}: {time.process_time() - start:.0f} s", file=sys.stderr)
    print("| | foreseen | achieved by foreseen | truth in the 95 % interval |")
    print("|---|---|---|---|")
    for one in design.outlooks:
        tried = ratios[one.name]
        scale = 2e-13 if one.name == "C_L" else one.value
        foreseen = f"{100.0 * one.after / scale:.3f} %" if one.is_told_after else "not identifiable"
        shown = f"{min(tried):.2f} to {max(tried):.2f}" if tried else ""
        print(f"| {one.name} | {foreseen} | {shown} | {hits[one.name]} of {len(tried)} |")
    every = [ratio for tried in ratios.values() for ratio in tried]
    spread = math.exp(float(np.std(np.log(every))))
    print(f"\nratios: median {np.median(every):.2f}, a standard deviation is a factor {spread:.2f}")


if __name__ == "__main__":
    main()
