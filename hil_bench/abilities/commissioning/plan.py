"""The plan of a commissioning: its keys, its checks, and the guard of its limits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig
from hil_bench.config.document import Document, Sort, Tables
from hil_bench.config.settings import Problems, convert, read_rows
from hil_bench.errors import ConfigError, HilBenchError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, require_cylinder
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

# The keys of a commissioning plan, which `plan.tsv` declares.
#
# What is given as a share of the data sheet's value (``..._tolerance_percent``) is right within
# that share of it, either way.

_GROUPS = {"communication": (), **read_rows(Path(__file__).with_name("plan.tsv")).groups}

PLAN_KEYS = _GROUPS.pop("plan")
LIMIT_KEYS = _GROUPS.pop("limits")
STEP_LIMIT_KEYS = tuple(key._replace(default=None, example="") for key in LIMIT_KEYS)
"""A step's own limits; what it does not give is as in ``[limits]``."""

STEP_KEYS = _GROUPS
"""By the name of a step."""


# The plan of a commissioning: which steps, how far they may go, what is right.
#
# A plan is a TOML file: ``[plan]``, ``[limits]``, then one table a step in the order in which
# they are to run. Its keys and their meaning stand in docs/commissioning.md.

SETTLING = 0.3
"""Time of steady motion before a sweep [s]."""

SUNK = 3e-3
"""How far beyond the stroke limits may lie that allow contact [m]: stops give, sensors are off."""

NEAR_STOP = 15e-3
"""Way before such a limit on which the contact speed holds [m]."""


class StepKind(StrEnum):
    """The steps there are."""

    COMMUNICATION = "communication"
    SENSORS = "sensors"
    DIRECTION = "direction"
    DEAD_BAND = "dead_band"
    RAMP = "ramp"
    STEPS = "steps"
    CHIRP = "chirp"
    LEAKAGE = "leakage"

    @property
    def moves(self) -> bool:
        """Return True if the valve is opened."""
        return self not in {StepKind.COMMUNICATION, StepKind.SENSORS}


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a step; leaving one closes the valve.

    Attributes:
        position: lowest and highest [m].
        speed: highest, either way [m/s].
        pressure: lowest and highest of either chamber [Pa].
        time: longest duration of the step [s].
        contact_speed: highest towards an end stop, close to it [m/s]; None where the piston may not
            touch one.
    """

    position: tuple[float, float]
    speed: float
    pressure: tuple[float, float]
    time: float
    contact_speed: float | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a plan.

    Attributes:
        kind: which.
        limits: how far it may go.
        values: its other keys in SI units, by the name of the key without its unit; none of those
            without a default that the plan leaves out.
    """

    kind: StepKind
    limits: Limits
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class CommissioningPlan:
    """A whole plan.

    Attributes:
        path: the file.
        bench: the bench as it should be, as the plan names it; None for what the command line says.
        axis: the axis to commission; None for the first.
        period: between two samples [s].
        steps: in order.
    """

    path: Path
    bench: Path | None
    axis: str | None
    period: float
    steps: tuple[Step, ...]


def load_plan(path: Path) -> CommissioningPlan:
    """Return the plan of a file; every problem is told at once, a line each."""
    file = Tables.of_file(path, Sort.PLAN, ("plan", "limits", *StepKind))
    plan, limits = file.table("plan", PLAN_KEYS), file.table("limits", LIMIT_KEYS)
    tables = {
        kind: file.table(kind, (*STEP_KEYS[kind], *STEP_LIMIT_KEYS))
        for kind in _kinds(file.document, file.problems)
    }
    file.problems.raise_any()
    common = convert(limits, LIMIT_KEYS)
    steps = []
    for kind, table in tables.items():
        own = convert(table, STEP_LIMIT_KEYS)
        given = {name: value for name, value in own.items() if value is not None}
        values = convert(table, STEP_KEYS[kind])
        values = {name: value for name, value in values.items() if value is not None}
        steps.append(Step(StepKind(kind), Limits(**{**common, **given}), values))
    values = convert(plan, PLAN_KEYS)
    bench = values["bench"]
    return CommissioningPlan(
        path,
        None if bench is None else path.parent / bench,
        values["axis"],
        values["period"],
        tuple(steps),
    )


def _kinds(document: Document, problems: Problems) -> list[StepKind]:
    """Return the steps in the order of the file, and note what is out of order."""
    kinds = [StepKind(name) for name in document if name in set(StepKind)]
    if not kinds:
        problems.add(problems.source, "has no steps; give tables such as [communication]")
    elif kinds[0] is not StepKind.COMMUNICATION:
        place = problems.place(kinds[0])
        problems.add(place, "comes before [communication]; that step is right as the first")
    for index, kind in enumerate(kinds):
        is_blind = kind.moves and kind is not StepKind.DIRECTION
        if is_blind and StepKind.DIRECTION not in kinds[:index]:
            what = "moves the axis before [direction] knows which way; give [direction] before it"
            problems.add(problems.place(kind), what)
    return kinds


def choose_axis(plan: CommissioningPlan, config: BenchConfig) -> CylinderConfig:
    """Return the axis that a plan is for.

    Raises:
        ConfigError: the bench has none of this name, or it is no cylinder.
    """
    if plan.axis is None:
        return require_cylinder(config.first_axis, "commissioning")
    for axis in config.axes:
        if axis.name == plan.axis:
            return require_cylinder(axis, "commissioning")
    names = ", ".join(axis.name for axis in config.axes)
    raise ConfigError(f"{plan.path}:plan.axis: the bench has no {plan.axis}; give one of {names}")


def check_against(plan: CommissioningPlan, axis: CylinderConfig) -> None:
    """Refuse a plan that would leave the stroke, or its own limits, by what the data sheet says."""
    problems = Problems(str(plan.path))
    half = axis.parameters.h
    for step in plan.steps:
        low, high = step.limits.position
        is_touching = step.limits.contact_speed is not None
        most = half + (SUNK if is_touching else 0.0)
        if low < -most or high > most:
            allowed = (
                f"at most {SUNK * 1e3:g} mm beyond it"
                if is_touching
                else "within it, or contact_speed_mm_s too if the piston may touch its stops"
            )
            problems.add(
                problems.place(step.kind),
                f"may go from {low * 1e3:g} to {high * 1e3:g} mm, the stroke is "
                f"{-half * 1e3:g} to {half * 1e3:g} mm; give position_mm {allowed}",
            )
        opening, parameters = step.values.get("opening"), axis.parameters
        if opening is not None and expected_speed(opening, parameters) <= 0.0:
            dead = parameters.beta / parameters.full_opening
            wrong = f"{100 * opening:g} is within the dead band of {100 * dead:.3g} %"
            right = "the axis would not move by the data sheet; give more"
            problems.add(problems.place(step.kind, "opening_percent"), f"{wrong}: {right}")
        travel = expected_travel(step, axis.parameters)
        room = high - low
        if travel > 0.9 * room:
            problems.add(
                problems.place(step.kind),
                f"would move {travel * 1e3:.0f} mm by the data sheet, its limits leave "
                f"{room * 1e3:.0f} mm; give a smaller opening_percent or a shorter duration_s",
            )
    problems.raise_any()


def expected_travel(step: Step, parameters: PlantParameters) -> float:
    """Return the travel of a step in one direction by the data sheet [m]."""
    speed = expected_speed(step.values.get("opening", 0.0), parameters)
    duration = step.values.get("duration", 0.0)
    match step.kind:
        case StepKind.DIRECTION | StepKind.STEPS:
            return speed * duration
        case StepKind.CHIRP:
            return speed * (duration + SETTLING)
        case StepKind.LEAKAGE:
            return speed * step.values["motion_time"]
        case StepKind.DEAD_BAND | StepKind.RAMP:
            # The speed rises from the edge of the dead band to its peak and falls again.
            d = parameters.beta / parameters.full_opening
            opening = step.values["opening"]
            return speed * 0.5 * max(0.0, 1.0 - d / opening) * 0.5 * duration
        case _:
            return 0.0


def expected_speed(opening: float, parameters: PlantParameters) -> float:
    """Return the piston speed at an opening by the data sheet [m/s].

    Without load and friction half of the pressure drops over each edge, eqs. (14) and (16).
    """
    z = opening * parameters.full_opening - parameters.beta
    flow = min(max(z, 0.0), parameters.alpha) * parameters.K
    return flow * math.sqrt(0.5 * (parameters.P_S - parameters.P_T)) / parameters.mean_area


# Samples of an axis against the limits of a step.


class LimitError(HilBenchError):
    """A step left one of its limits, and the valve was closed."""


class Sample(NamedTuple):
    """The drivers' values at one moment; the fields of `SAMPLE_CHANNELS`, in SI units."""

    time: float
    position: float
    speed: float
    pressure_a: float
    pressure_b: float
    spool_setpoint: float
    spool_position: float


def check_sample(sample: Sample, limits: Limits) -> None:
    """Compare a sample with the limits; a `LimitError` says which it is beyond, or what is none."""
    _check_range("position", sample.position, limits.position, 1e-3, "mm")
    _check_range("speed", sample.speed, (-limits.speed, limits.speed), 1e-3, "mm/s")
    _check_range("pressure at A", sample.pressure_a, limits.pressure, 1e5, "bar")
    _check_range("pressure at B", sample.pressure_b, limits.pressure, 1e5, "bar")
    if limits.contact_speed is not None:
        low, high = limits.position
        lowest = -limits.contact_speed if sample.position < low + NEAR_STOP else -math.inf
        highest = limits.contact_speed if sample.position > high - NEAR_STOP else math.inf
        _check_range("speed at the end stop", sample.speed, (lowest, highest), 1e-3, "mm/s")


def _check_range(
    what: str, value: float, limits: tuple[float, float], factor: float, unit: str
) -> None:
    """Compare a value with its limits.

    Raises:
        LimitError: it is beyond them, or no number.
    """
    low, high = limits
    if math.isnan(value):
        raise LimitError(f"{what} is not valid by the status of its sensor")
    if not low <= value <= high:
        beyond = low if value < low else high
        raise LimitError(
            f"{what} {value / factor:.4g} {unit} is beyond its limit of {beyond / factor:g} {unit}"
        )
