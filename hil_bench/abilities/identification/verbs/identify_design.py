"""`hil-bench identify --design`: the strokes to record, as a scenario."""

import argparse
import json
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.commissioning.plan import (
    CommissioningPlan,
    Limits,
    check_against,
    load_plan,
)
from hil_bench.abilities.common.arguments import find_cylinder
from hil_bench.abilities.common.members import find_members
from hil_bench.abilities.identification.design import (
    Bounds,
    StrokeRun,
    Twin,
    plan_strokes,
    shorten_course,
)
from hil_bench.abilities.scenario.records import Controller, Expectation, Scenario, SetStep
from hil_bench.abilities.scenario.writing import to_toml
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.exit_codes import Ending
from hil_bench.errors import ConfigError, about_file
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.units import BAR

Values = npt.NDArray[np.float64]

_SCENARIO, _COURSE = "design.scenario.toml", "design.csv"
_BEGIN = 0.5  # [s], by which the example controller has set the devices up
_LONGEST, _USUAL = 600.0, 60.0  # [s]


class Question(NamedTuple):
    """The machine that is asked about.

    Attributes:
        config: of the bench.
        axis: the axis.
        bench: the bench's file; None for the built-in one.
    """

    config: BenchConfig
    axis: CylinderConfig
    bench: Path | None = None


def add_design_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns the next manoeuvre."""
    group = parser.add_argument_group("the next manoeuvre")
    group.add_argument(
        "--design",
        action="store_true",
        help="write the strokes to record as a scenario, within the limits of the machine, from "
        "the bench.toml alone",
    )
    group.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="with --design: longest duration of the run (default: 60)",
    )
    group.add_argument(
        "--plan",
        type=Path,
        metavar="PLAN.toml",
        help="with --design: plan of the machine's commissioning, whose [limits] hold",
    )


def check_design_arguments(args: argparse.Namespace) -> None:
    """Refuse options that go with --design where it is missing, and wrong ones.

    Raises:
        ConfigError: there is one.
    """
    for option in ("duration", "plan"):
        if getattr(args, option) is not None and not args.design:
            raise ConfigError(f"--{option}: belongs to --design")
    if args.duration is not None and not 2.0 <= args.duration <= _LONGEST:
        raise ConfigError(f"--duration {args.duration:g}: give 2 to {_LONGEST:g}")


def run_design(args: argparse.Namespace, asked: Question) -> int:
    """Plan the strokes to record, write and print them."""
    config, axis = asked.config, asked.axis
    _valve(asked)
    plan = None if args.plan is None else load_plan(args.plan)
    twin = Twin(
        axis=axis.name,
        parameters=axis.parameters,
        options=axis.options,
        step=config.dt,
        interval=config.tick_ns * 1e-9 if plan is None else plan.period,
        full_opening=config.full_scale(axis),
    )
    limits = _limits(plan, asked)
    design = plan_strokes(twin, Bounds.of(axis, limits), args.duration or _USUAL)
    files: list[Path] = []
    ending = Ending(args)
    with ending.going_on():
        files += write_design(args.output, design, asked, limits)
    if args.json:
        parts = [{"at_s": time, "name": name} for time, name in design.names]
        content = {
            "axis": design.axis,
            "duration_s": design.duration,
            "openings": [*design.openings],
            "parts": parts,
        }
        print(json.dumps({"design": content, "files": [*map(str, files)]}, indent=2))
    elif not args.quiet:
        lines = [*_summary(design, has_plan=plan is not None), ""]
        print("\n".join([*lines, *(f"wrote {path}" for path in files)]))
    return ending.code


def _summary(design: StrokeRun, *, has_plan: bool) -> list[str]:
    x, v, pressures = design.states[:, 0], design.states[:, 1], design.states[:, 2:]
    motion = (
        f"expected motion: from {1e3 * design.start:.0f} mm to between {1e3 * x.min():.0f} and "
        f"{1e3 * x.max():.0f} mm, up to {1e3 * np.abs(v).max():.0f} mm/s, "
        f"{BAR.from_si(pressures.min()):.0f} to {BAR.from_si(pressures.max()):.0f} bar"
    )
    return [
        f"{design.axis}: {design.duration:.1f} s of strokes both ways",
        *(f"  from {time:5.1f} s  {name}" for time, name in design.names),
        motion,
        *([] if has_plan else ["limits: the stroke alone; --plan adds those of the machine"]),
    ]


def write_design(
    directory: Path, design: StrokeRun, asked: Question, limits: Limits | None
) -> list[Path]:
    """Write the scenario and its course; return the files."""
    paths = [directory / _SCENARIO, directory / _COURSE]
    scenario = _scenario(paths[0], design, asked, limits)
    course = shorten_course(design.setpoints, design.interval)
    rows = ["time_s,value", *(f"{time:g},{value:g}" for time, value in course)]
    comments = [
        "# Strokes to record for hil-bench identify, by hil-bench identify --design.",
        *(f"# from {_BEGIN + time:.2f} s: {name}" for time, name in design.names),
        f"# Begin with the piston near {design.start * 1e3:.0f} mm.",
    ]
    texts = ["\n".join([*comments, to_toml(scenario)]), "\n".join(rows) + "\n"]
    for path, text in zip(paths, texts, strict=True):
        with about_file(path, right="give a directory of yours"):
            path.write_text(text, encoding="utf-8", errors="backslashreplace")
    return paths


def _limits(plan: CommissioningPlan | None, asked: Question) -> Limits | None:
    """Return the limits of a plan.

    Raises:
        ConfigError: it is for another axis, or does not fit this one.
    """
    if plan is None:
        return None
    axis = find_cylinder(asked.config, plan.axis, "identification")
    if plan.axis is not None and axis.name != asked.axis.name:
        raise ConfigError(f"{plan.path}: is for {axis.name}; give --axis {axis.name}")
    check_against(plan, asked.axis)
    return plan.steps[0].limits


def _scenario(path: Path, design: StrokeRun, asked: Question, limits: Limits | None) -> Scenario:
    axis, valve = design.axis, _valve(asked)
    bench = None
    if asked.bench is not None:
        bench = Path(os.path.relpath(asked.bench, path.parent)).as_posix()
    return Scenario(
        path=path,
        title=f"Identification of {axis}: strokes both ways",
        bench=bench,
        duration=round(_BEGIN + design.duration + 0.1, 3),
        requirement_ids=(),
        controller=Controller(example="manual"),
        parameters=(),
        steps=(SetStep(at=_BEGIN, target=f"{valve}.spool_setpoint", value=0.0, table=_COURSE),),
        expectations=tuple(_expectations(asked.axis, limits)),
    )


def _expectations(axis: CylinderConfig, limits: Limits | None) -> list[Expectation]:
    h = axis.parameters.h
    low, high = (1e3 * end for end in ((-h, h) if limits is None else limits.position))
    x = f"{axis.name}.position"
    claims = {"position": f"{x} > {low:g} mm and {x} < {high:g} mm"}
    if limits is not None:
        claims["speed"] = f"abs({axis.name}.speed) < {limits.speed * 1e3:g} mm/s"
        low, high = map(BAR.from_si, limits.pressure)
        for side in "AB":
            p = f"{axis.name}.P_{side}"
            claims[f"pressure {side}"] = f"{p} > {low:g} bar and {p} < {high:g} bar"
    return [Expectation(name, f"always {claim}") for name, claim in claims.items()]


def _valve(asked: Question) -> str:
    members = find_members(asked.config, asked.axis.name, "--design")
    return members.valve.name
