"""An ability: `hil-bench springs` computes how each mass on a spring of a bench swings."""

import argparse
import json
import math
from pathlib import Path

from hil_bench import load_config
from hil_bench.ability import Ability, Verb
from spring_rig.mass_on_spring import SpringConfig

SPRINGS = Ability(
    "springs",
    verbs={
        "springs": Verb(
            "more", 100, "compute how the masses on springs of a bench swing", "spring_rig.springs"
        )
    },
)


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "springs",
        description="Compute natural frequency and damping ratio of each mass on a spring.",
    )
    parser.add_argument("config", type=Path, metavar="bench.toml", help="the bench")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print them; exit code 6 where the bench has no mass on a spring."""
    found = {}
    for axis in load_config(args.config).axes:
        if isinstance(axis, SpringConfig):
            rate = math.sqrt(axis.stiffness / axis.mass)  # [rad/s]
            ratio = axis.damping / (2.0 * axis.mass * rate)
            found[axis.name] = {"frequency_hz": rate / (2.0 * math.pi), "damping_ratio": ratio}
    if args.json:
        print(json.dumps(found, indent=2))
    else:
        for name, row in found.items():
            print(f"{name}: {row['frequency_hz']:.3g} Hz, damping ratio {row['damping_ratio']:.3g}")
    return 0 if found else 6
