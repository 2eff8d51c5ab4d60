"""A scenario with its numbers in: steps as actions at ticks, expectations as typed trees."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.registry import COMMON_KEYS, find_fault_kind
from hil_bench.abilities.faults.section import build_fault, check_amount, check_effect
from hil_bench.abilities.scenario import records
from hil_bench.abilities.scenario.dimensions import unit_of_name
from hil_bench.abilities.scenario.monitor import window_ticks
from hil_bench.abilities.scenario.nodes import Condition, Vocabulary, Windowed
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.reach import CERTAIN, is_certain, look_back, reach, walk
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.session import Session
from hil_bench.config.settings import Problems, read_table
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError
from hil_bench.units import ONE, Unit

_NEVER = 1e9
"""A time after the end of every scenario [s]."""


class SetAction(NamedTuple):
    """A target gets a value.

    Attributes:
        target: its name.
        value: the value, of a course the last one.
        over_ticks: length of the straight ramp from the present value; 0 for at once.
        course: ticks after the action's own and values, straight lines between; empty for none.
        units: symbols of the units in which its values are given; bare numbers have none.
    """

    target: str
    value: float
    over_ticks: int = 0
    course: tuple[tuple[int, float], ...] = ()
    units: tuple[str, ...] = ()

    @property
    def values(self) -> tuple[float, ...]:
        """All values that the target gets, without what is between them."""
        return (self.value, *(value for _, value in self.course))

    def points(self, tick: int, present: float) -> tuple[tuple[int, float], ...]:
        """Return ticks and values, straight lines between.

        Args:
            tick: that of the action.
            present: the value then.
        """
        if self.course:
            return tuple((tick + after, value) for after, value in self.course)
        if self.over_ticks:
            return (tick, present), (tick + self.over_ticks, self.value)
        return ((tick, self.value),)


Action = SetAction | FaultConfig | records.NmtStep | records.SyncStep | records.FirmwareStep


class TimedAction(NamedTuple):
    """An action of a runner at the start of a tick.

    Attributes:
        tick: its number, from 0.
        action: what.
        place: how messages name the step: file, line and column.
    """

    tick: int
    action: Action
    place: str = ""


class Requirement(NamedTuple):
    """An expectation that is ready to be judged.

    Attributes:
        id: of the requirement.
        that: its text.
        condition: its tree.
    """

    id: str
    that: str
    condition: Condition


def parameter_values(
    scenario: records.Scenario | records.RequirementsFile,
    given: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return the SI value of each parameter.

    Args:
        scenario: the file that has them.
        given: values in the parameters' own units that win over the file's.

    Raises:
        ConfigError: a value is given to what is no parameter.
    """
    names = [each.name for each in scenario.parameters]
    for name in given or {}:
        if name not in names:
            near = f"the nearest is {find_nearest(name, names)}; or " if names else ""
            wrong = f"{quote(name)} is not in [parameters]; {near}add it there"
            raise ConfigError(f"{scenario.path}: {wrong}")
    own = {each.name: each.value for each in scenario.parameters} | dict(given or {})
    return {each.name: each.unit.to_si(own[each.name]) for each in scenario.parameters}


def resolve_steps(
    scenario: records.Scenario,
    tick_ns: int,
    values: Mapping[str, float],
    sensor_units: Mapping[str, Unit | None] = MappingProxyType({}),
) -> tuple[TimedAction, ...]:
    """Return the steps as actions, in the order of time, and of the file within a tick.

    A step between two ticks acts at the later one.

    Args:
        scenario: whose steps.
        tick_ns: time between two ticks [ns].
        values: the SI value of each parameter.
        sensor_units: those in which faults have their amounts, as in a `BenchConfig`; steps that
            disturb a sensor without one are not checked.

    Raises:
        ConfigError: a fault lacks its amount, or has it in another unit than its sensor measures;
            or a parameter's value, or the ticks, bring a step behind the end.
    """
    resolver = _Resolver(scenario, tick_ns, values, sensor_units)
    actions = [
        TimedAction(resolver.ticks(step.at), resolver.action(step), step.place)
        for step in scenario.steps
    ]
    last = records.ticks_of(scenario.duration, tick_ns) - 1
    late = [
        f"{each.place}: acts behind the last tick, at {last * tick_ns / 1e9:g} s; "
        "give an earlier time or a longer duration_s"
        for each in actions
        if each.tick > last
    ]
    if late:
        raise ConfigError("\n".join(late))
    return tuple(sorted(actions, key=lambda each: each.tick))


def compile_expectations(
    scenario: records.Scenario, vocabulary: Vocabulary, tick_ns: int = 1
) -> tuple[Requirement, ...]:
    """Return the expectations, parsed.

    Args:
        scenario: whose expectations.
        vocabulary: the names they may use, the parameters among them.
        tick_ns: time between two ticks [ns]; windows shorter than one are refused.

    What is wrong comes as one `ConfigError`, a line a problem, with file, line and column.
    """
    return compile_texts(scenario.expectations, vocabulary, scenario.duration, tick_ns)


def compile_texts(
    expectations: Iterable[records.Expectation],
    vocabulary: Vocabulary,
    duration: float = math.inf,
    tick_ns: int = 1,
) -> tuple[Requirement, ...]:
    """Return expectations, parsed.

    Args:
        expectations: which.
        vocabulary: the names they may use, the parameters among them.
        duration: of the run [s].
        tick_ns: time between two ticks [ns]; windows shorter than one are refused.

    Raises:
        ConfigError: a line a problem, each with file, line and column.
    """
    found, wrong = [], []
    for each in expectations:
        try:
            condition = parse_expectation(each.that, vocabulary)
            for node in walk([condition]):
                if isinstance(node, Windowed):
                    window_ticks(node, node.window, tick_ns)
        except ExpectationError as error:
            wrong.append(f"{each.place.at(*error.position)}: {each.id}: {error.what}")
            continue
        if problem := _problem_of_time(condition, duration):
            right = "give shorter windows or a longer duration_s"
            lasts = f"and the scenario lasts {duration:g} s; {right}"
            wrong.append(f"{each.place.at(1, 1)}: {each.id}: {problem}, {lasts}")
        found.append(Requirement(each.id, each.that, condition))
    if wrong:
        raise ConfigError("\n".join(wrong))
    return tuple(found)


def _problem_of_time(condition: Condition, duration: float) -> str:
    """Return why a run is too short for a condition; empty where it is not."""
    if (needed := reach(condition) / 1e9) > duration:
        return f"needs {needed:g} s to be decided"
    if (back := look_back(condition) / 1e9) > duration:
        return f"looks back {back:g} s"
    return ""


class _Resolver:
    """Puts numbers in."""

    def __init__(
        self,
        scenario: records.Scenario,
        tick_ns: int,
        values: Mapping[str, float],
        sensor_units: Mapping[str, Unit | None],
    ) -> None:
        self._source, self._sensor_units = str(scenario.path), sensor_units
        self._tick_ns, self._values = tick_ns, values

    def ticks(self, time: records.Amount) -> int:
        """Return the first tick at a time [s] or after it."""
        return -(-round(min(self._number(time), _NEVER) * 1e9) // self._tick_ns)

    def action(
        self,
        step: records.SetStep
        | records.FaultStep
        | records.NmtStep
        | records.SyncStep
        | records.FirmwareStep,
    ) -> Action:
        """Return the action of a step."""
        match step:
            case records.SetStep():
                course = tuple(
                    (self.ticks(time), self._number(amount)) for time, amount in step.points
                )
                value = self._number(step.value)
                amounts = (step.value, *(amount for _, amount in step.points))
                units = {step.unit, *(_unit(amount) for amount in amounts)} - {""}
                over = self.ticks(step.over)
                return SetAction(step.target, value, over, course, tuple(sorted(units)))
            case records.FaultStep():
                return self._fault(step)
            case _:
                return step

    def _number(self, amount: records.Amount) -> float:
        return self._values[amount.name] if isinstance(amount, records.Reference) else amount

    def _fault(self, step: records.FaultStep) -> FaultConfig:
        own = {name: self._in_unit_of(name, value) for name, value in step.values}
        given = {"kind": step.kind, "target": step.target, "at_s": self._number(step.at), **own}
        problems = Problems(self._source)
        keys = (*COMMON_KEYS, *find_fault_kind(step.kind).keys)
        table = f"step {step.kind} {step.target}"
        found = read_table(table, given, keys, problems)
        problems.raise_any()
        if step.target in self._sensor_units:
            check_amount(found, self._sensor_units[step.target], problems)
        literal = [name for name, value in step.values if not isinstance(value, records.Reference)]
        check_effect(found, problems, literal)
        problems.raise_any()
        from_parameters = Problems(self._source)
        check_effect(found, from_parameters)
        return replace(build_fault(found), is_baseline=from_parameters.has_any)

    def _in_unit_of(self, key: str, value: object) -> object:
        """Return the value of a key, in the key's unit."""
        if isinstance(value, records.Reference):
            return unit_of_name(key).unit.from_si(self._values[value.name])
        return value


def _unit(amount: records.Amount) -> str:
    """Return the symbol of the unit of a parameter; empty where it has none, and for a number."""
    unit = unit_of_name(amount.name).unit if isinstance(amount, records.Reference) else ONE
    return "" if unit is ONE else unit.symbol


# A scenario that is ready to be played.


@dataclass(frozen=True, slots=True)
class PreparedScenario:
    """A scenario that fits its bench.

    Attributes:
        scenario: as loaded.
        config: its bench.
        parameters: the SI value of each parameter.
        actions: its steps.
        requirements: its expectations.
        sessions: the one that it was checked on, for the first run; empty unless asked for.
    """

    scenario: records.Scenario
    config: BenchConfig
    parameters: Mapping[str, float]
    actions: tuple[TimedAction, ...]
    requirements: tuple[Requirement, ...]
    sessions: list[Session] = field(default_factory=list, compare=False, repr=False)

    @property
    def doubts(self) -> list[str]:
        """The requirements that cannot fail, a line each."""
        certain = [each.id for each in self.requirements if is_certain(each.condition)]
        return [f"{self.scenario.path}: {each}: {CERTAIN}" for each in certain]

    @property
    def last_tick(self) -> int:
        """Number of the last tick of a run."""
        return records.ticks_of(self.scenario.duration, self.config.tick_ns) - 1
