"""`hil-bench identify --design`: the manoeuvre that would tell more, as a scenario."""

import argparse
import json
import math
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
from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.choosing import Design, Designer
from hil_bench.abilities.identification.design.course import shorten_course
from hil_bench.abilities.identification.design.foresight import Foresight
from hil_bench.abilities.identification.design.report import design_to_json, summarise_design
from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.fit import require_startable
from hil_bench.abilities.identification.ladder import ALIASES, PAPER
from hil_bench.abilities.identification.machine import Template
from hil_bench.abilities.scenario.records import Controller, Expectation, Scenario, SetStep
from hil_bench.abilities.scenario.writing import to_toml
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.members import find_members
from hil_bench.cli.arguments import find_cylinder
from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.progress import Work, shown_work
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.errors import ConfigError, about_file
from hil_bench.kinds.motion_sensor import MotionConfig
from hil_bench.kinds.pressure_404 import PressureConfig
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.courses import states_without_start
from hil_bench.units import BAR, MICROMETRE, MILLIMETRE, MILLIMETRE_PER_SECOND

Values = npt.NDArray[np.float64]
Chains = tuple[ChainParameters | None, ChainParameters | None]

_SCENARIO, _COURSE = "design.scenario.toml", "design.csv"
_BEGIN = 0.5  # [s], by which the example controller has set the devices up
_TYPICAL = (3e-6, 5e3)  # [m], [Pa]: noise of sensors of which nothing is said
_STOP = "stroke_mm"
_LONGEST = 600.0  # [s]


class Question(NamedTuple):
    """The subject of a design.

    Attributes:
        config: of the bench.
        bench: its file; None for the built-in one.
        axis: the axis.
        names: the sought parameters.
        chains: of the sensors of position and pressure.
    """

    config: BenchConfig
    bench: Path | None
    axis: CylinderConfig
    names: tuple[str, ...]
    chains: Chains


def add_design_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns the next manoeuvre."""
    group = parser.add_argument_group("the next manoeuvre")
    group.add_argument(
        "--design",
        action="store_true",
        help="find the manoeuvre that would identify most, and write it as a scenario, from the "
        "bench.toml alone, such as one that identify has written",
    )
    group.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="with --design: longest duration of the manoeuvre (default: 20)",
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


def find_design(args: argparse.Namespace, asked: Question) -> tuple[Design, tuple[str, ...]]:
    """Return the run that would tell most, and what that rests on."""
    _valve(asked)
    plan = None if args.plan is None else load_plan(args.plan)
    limits = _limits(plan, asked)
    twin, notes = _twin(asked, plan)
    names, bounds, aside = asked.names, Bounds.of(asked.axis, limits), tuple[str, ...]()
    if bounds.stops and not {_STOP} & {*args.fix, *names}:
        names, aside = (*names, _STOP), (_STOP,)
    table = f"plant.{asked.axis.name}"
    settings = {one.key.name: one for one in asked.config.settings if one.table == table}
    foresight = Foresight(twin, Template(asked.axis, settings, 1), names)
    with shown_work(args, Work("identify --design", unit="manoeuvres")) as work:
        designer = Designer(foresight, bounds, aside, work.begin)
        found = designer.design(20.0 if args.duration is None else args.duration)
    if bounds.stops:
        stops = " and ".join(f"{MILLIMETRE.from_si(stop):g} mm" for stop in bounds.stops)
        speed = MILLIMETRE_PER_SECOND.from_si((limits and limits.contact_speed) or 0.0)
        notes = (*notes, f"the piston may touch the end stops at {stops}, at up to {speed:g} mm/s")
    if plan is None:
        notes = (*notes, "limits: the stroke alone; give --plan for those of speed and pressure")
    return found, notes


def run_design(
    args: argparse.Namespace, config: BenchConfig, bench: Path | None, axis: CylinderConfig
) -> int:
    """Find the manoeuvre that would tell most, write and print it.

    Raises:
        ConfigError: nothing is left to be sought, or no manoeuvre stays within the limits.
    """
    require_startable(states_without_start(axis.options))
    wanted = (*PAPER, "spool_damping_ratio", "orifice_full_opening_mm", *args.free)
    names = tuple(dict.fromkeys(ALIASES.get(key, key) for key in wanted if key not in args.fix))
    if not names:
        raise ConfigError("--fix: nothing is left to be sought")
    asked = Question(config, bench, axis, names, _find_chains(config, axis))
    design, notes = find_design(args, asked)
    files: list[Path] = []
    ending = Ending(args)
    with ending.going_on():
        files += write_design(args.output, design, asked, args.plan)
    if args.json:
        content = {"design": design_to_json(design), "files": [str(path) for path in files]}
        print(json.dumps(content, indent=2))
    elif not args.quiet:
        lines = [summarise_design(design, notes), "", *(f"wrote {path}" for path in files)]
        print("\n".join(lines))
    return ending.code


def _find_chains(config: BenchConfig, axis: CylinderConfig) -> Chains:
    """Return the chains of an axis's sensors of position and pressure, as far as it has them."""
    mine = [node for node in config.nodes if node.axis == axis.name]
    position = (node.chain for node in mine if isinstance(node, MotionConfig))
    pressure = (node.chain for node in mine if isinstance(node, PressureConfig))
    return next(position, None), next(pressure, None)


def write_design(directory: Path, design: Design, asked: Question, plan: Path | None) -> list[Path]:
    """Write the scenario and its course; return the files."""
    paths = [directory / _SCENARIO, directory / _COURSE]
    scenario = _scenario(paths[0], design, asked, plan)
    course = shorten_course(design.setpoints, design.interval)
    rows = ["time_s,value", *(f"{time:g},{value:g}" for time, value in course)]
    comments = [
        "# The manoeuvre that would identify more of this axis, by hil-bench identify --design.",
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


def _twin(asked: Question, plan: CommissioningPlan | None) -> tuple[Twin, tuple[str, ...]]:
    """Return the twin in place of the machine, and notes on it."""
    config, axis = asked.config, asked.axis
    noise, note = _noise(asked)
    twin = Twin(
        axis=axis.name,
        parameters=axis.parameters,
        options=axis.options,
        step=config.dt,
        interval=config.tick_ns * 1e-9 if plan is None else plan.period,
        full_opening=config.full_scale(axis),
        noise=noise,
    )
    return twin, (note,)


def _noise(asked: Question) -> tuple[Values, str]:
    """Return the noise of each signal, and where it comes from."""
    position, pressure = map(_chain_noise, asked.chains)
    source = "by the chains of the sensors" if position and pressure else "in part assumed"
    pressure = pressure or _TYPICAL[1]
    noise = np.array([position or _TYPICAL[0], pressure, pressure])
    if not any(map(_chain_noise, asked.chains)):
        source = "assumed"
    texts = [f"position {MICROMETRE.from_si(noise[0]):.3g} um"]
    texts += [
        f"{name} {BAR.from_si(value):.3g} bar"
        for name, value in zip(("P_A", "P_B"), noise[1:], strict=True)
        if math.isfinite(value)
    ]
    return noise, f"noise, {source}: {', '.join(texts)}"


def _chain_noise(chain: ChainParameters | None) -> float:
    """Return the standard deviation of what a chain adds; 0 for none."""
    if chain is None:
        return 0.0
    parts = (
        chain.noise_rms,
        chain.noise_density * math.sqrt(chain.bandwidth),
        chain.resolution / math.sqrt(12.0),
        0.5 * chain.hysteresis,
    )
    return math.hypot(*parts)


def _scenario(path: Path, design: Design, asked: Question, plan: Path | None) -> Scenario:
    axis, valve = design.axis, _valve(asked)
    bench = None
    if asked.bench is not None:
        bench = Path(os.path.relpath(asked.bench, path.parent)).as_posix()
    limits = Bounds.of(asked.axis, None if plan is None else _limits(load_plan(plan), asked)).limits
    return Scenario(
        path=path,
        title=f"Identification of {axis}: the most informative manoeuvre",
        bench=bench,
        duration=round(_BEGIN + design.duration + 0.1, 3),
        requirement_ids=(),
        controller=Controller(example="manual"),
        parameters=(),
        steps=(SetStep(at=_BEGIN, target=f"{valve}.spool_setpoint", value=0.0, table=_COURSE),),
        expectations=tuple(_expectations(asked.axis, limits)),
    )


def _expectations(axis: CylinderConfig, limits: Limits | None) -> list[Expectation]:
    half = axis.parameters.h
    low, high = (-half, half) if limits is None else limits.position
    position = f"{axis.name}.position"
    found = [
        Expectation(
            "position",
            f"always {position} > {low * 1e3:g} mm and {position} < {high * 1e3:g} mm",
        )
    ]
    if limits is not None:
        speed = f"always abs({axis.name}.speed) < {limits.speed * 1e3:g} mm/s"
        found.append(Expectation("speed", speed))
        low, high = map(BAR.from_si, limits.pressure)
        found += [
            Expectation(
                f"pressure {side}",
                f"always {signal} > {low:g} bar and {signal} < {high:g} bar",
            )
            for side, signal in ((side, f"{axis.name}.P_{side}") for side in "AB")
        ]
    return found


def _valve(asked: Question) -> str:
    members = find_members(asked.config, asked.axis.name, "--design")
    return members.valve.name
