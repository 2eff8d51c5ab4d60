"""A failure made small: fewer steps, shorter, nearer to the file's values, rounder numbers."""

import math
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from hil_bench.campaign.records import RunResult
from hil_bench.campaign.sampling import Point
from hil_bench.campaign.search.records import Trial
from hil_bench.errors import ConfigError
from hil_bench.scenario.places import LocatedProblems
from hil_bench.scenario.reading import read_scenario
from hil_bench.scenario.records import Scenario, SetStep
from hil_bench.scenario.usage import unused_parameters
from hil_bench.scenario.writing import to_toml

_HALVINGS = 6
_MOST_DIGITS = 4

Run = Callable[[Scenario], RunResult]
"""Plays a scenario with the values of its file; a `ConfigError` says that it cannot be."""


class Target(NamedTuple):
    """What is to go on failing.

    Attributes:
        requirement: its id; empty for a run that does not come to its end.
    """

    requirement: str

    def is_hit(self, result: RunResult) -> bool:
        """Return whether a run still fails."""
        if not self.requirement:
            return result.outcome.is_cut_off
        return any(each.is_failed for each in result.verdicts if each.id == self.requirement)


class Shrunk(NamedTuple):
    """A small failure.

    Attributes:
        scenario: which fails with the values of its file.
        result: what comes of it.
        runs: how many the shrinking took.
        is_interrupted: whether it might become smaller.
    """

    scenario: Scenario
    result: RunResult
    runs: int
    is_interrupted: bool = False


def shrink(scenario: Scenario, trial: Trial, target: Target, run: Run) -> Shrunk | None:
    """Return a failure made small; None where it does not fail by itself again.

    A KeyboardInterrupt ends it: the failure is then as small as it has become.

    Args:
        scenario: with the values that are usual.
        trial: that showed the failure.
        target: what fails.
        run: plays a candidate.
    """
    shrinker = _Shrinker(scenario, target, run)
    try:
        if not shrinker.begin(trial.point):
            return None
        for part in (
            shrinker.drop_steps,
            shrinker.make_usual,
            shrinker.shorten,
            shrinker.make_smaller,
            shrinker.round_numbers,
            shrinker.drop_steps,
        ):
            part()
    except KeyboardInterrupt:
        found = shrinker.found
        return (
            as_found(scenario, trial, target)
            if found is None
            else found._replace(is_interrupted=True)
        )
    return shrinker.found


def as_found(scenario: Scenario, trial: Trial, target: Target) -> Shrunk:
    """Return a failure as the search has found it, for which nothing need be run.

    Args:
        scenario: with the values that are usual.
        trial: that showed the failure.
        target: what fails.
    """
    failing = _tidied(_alone(_at(scenario, trial.point), target))
    return Shrunk(failing, trial.result, 0, is_interrupted=True)


class _Shrinker:
    """Takes each step that leaves the failure."""

    def __init__(self, scenario: Scenario, target: Target, run: Run) -> None:
        self._usual = {each.name: each for each in scenario.parameters}
        self._scenario, self._target, self._run = scenario, target, run
        self._runs = 0
        self._result: RunResult | None = None

    @property
    def found(self) -> Shrunk | None:
        """What is found so far."""
        if self._result is None:
            return None
        return Shrunk(self._scenario, self._result, self._runs)

    def begin(self, point: Point) -> bool:
        """Take the values of the failure, and no other requirement; return whether it fails."""
        plain = _at(self._scenario, point)
        return self._try(_tidied(_alone(plain, self._target))) or self._try(plain)

    def drop_steps(self) -> None:
        """Leave steps out, the last first."""
        for place in reversed(range(len(self._scenario.steps))):
            steps = self._scenario.steps
            fewer = (*steps[:place], *steps[place + 1 :])
            self._try(_tidied(replace(self._scenario, steps=fewer)))

    def make_usual(self) -> None:
        """Give parameters the value of the file again."""
        for each in self._scenario.parameters:
            self._try(self._with(each.name, self._usual[each.name].value))

    def shorten(self) -> None:
        """End the run earlier."""
        low, high = 0.0, self._scenario.duration
        for _ in range(_HALVINGS):
            middle = round_to(0.5 * (low + high), 2)
            if not low < middle < high:
                return
            if self._try(replace(self._scenario, duration=middle)):
                high = middle
            else:
                low = middle

    def make_smaller(self) -> None:
        """Bring parameters nearer to the file's values, and values of steps nearer to 0."""
        for each in self._scenario.parameters:
            usual = self._usual[each.name].value
            self._approach(each.value, usual, partial(self._with, each.name))
        for place, step in enumerate(self._scenario.steps):
            if isinstance(step, SetStep) and isinstance(step.value, float) and not step.table:
                self._approach(step.value, 0.0, partial(self._with_step, place))

    def round_numbers(self) -> None:
        """Write numbers with fewer digits."""
        for each in self._scenario.parameters:
            self._round(each.value, partial(self._with, each.name))
        for place, step in enumerate(self._scenario.steps):
            if isinstance(step, SetStep) and isinstance(step.value, float) and not step.table:
                self._round(step.value, partial(self._with_step, place))

    def _approach(self, value: float, usual: float, change: Callable[[float], Scenario]) -> None:
        """Bring a number nearer to its usual value, by halving what is in doubt."""
        for _ in range(_HALVINGS):
            middle = 0.5 * (value + usual)
            if middle in {value, usual}:
                return
            if self._try(change(middle)):
                value = middle
            else:
                usual = middle

    def _round(self, value: float, change: Callable[[float], Scenario]) -> None:
        for rounded in _rounder(value):
            if self._try(change(rounded)):
                return

    def _with(self, name: str, value: float) -> Scenario:
        span = self._usual[name].span
        inside = min(max(value, span[0]), span[1]) if span else value
        changed = (
            replace(each, value=inside) if each.name == name else each
            for each in self._scenario.parameters
        )
        return replace(self._scenario, parameters=tuple(changed))

    def _with_step(self, place: int, value: float) -> Scenario:
        steps = list(self._scenario.steps)
        step = steps[place]
        if isinstance(step, SetStep):
            steps[place] = replace(step, value=value)
        return replace(self._scenario, steps=tuple(steps))

    def _try(self, candidate: Scenario) -> bool:
        """Take a candidate that still fails, as its file will be read."""
        if candidate == self._scenario and self._result is not None:
            return False
        try:
            result = self._run(_as_read(candidate))
        except ConfigError:
            return False
        self._runs += 1
        if not self._target.is_hit(result):
            return False
        self._scenario, self._result = candidate, result
        return True


def round_to(value: float, digits: int) -> float:
    """Return a number with some significant digits."""
    return float(f"{value:.{digits}g}")


def _rounder(value: float) -> Iterator[float]:
    """Yield shorter numbers, the shortest first."""
    for digits in range(1, _MOST_DIGITS + 1):
        rounded = round_to(value, digits)
        if rounded == value:
            return
        yield rounded
        if digits > 1:  # the neighbours away from the value: one of them may fail where it does not
            unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1) if value else 0.0
            yield from (round_to(rounded + unit, digits), round_to(rounded - unit, digits))


def _at(scenario: Scenario, point: Point) -> Scenario:
    """Return a scenario with the values of a point, which nothing varies."""
    parameters = tuple(
        replace(each, value=point.get(each.name, each.value), span=None)
        for each in scenario.parameters
    )
    return replace(scenario, parameters=parameters)


def _alone(scenario: Scenario, target: Target) -> Scenario:
    """Return a scenario without other requirements."""
    wanted = tuple(each for each in scenario.expectations if each.id == target.requirement)
    return replace(scenario, expectations=wanted) if wanted else scenario


def _as_read(scenario: Scenario) -> Scenario:
    """Return a scenario as the file has it that would be written."""
    document = tomllib.loads(to_toml(scenario))
    return read_scenario(scenario.path, document, LocatedProblems(str(scenario.path), {}))


def _tidied(scenario: Scenario) -> Scenario:
    """Return a scenario without the parameters that do nothing."""
    unused = {*unused_parameters(scenario)}
    kept = tuple(each for each in scenario.parameters if each.name not in unused)
    return replace(scenario, parameters=kept)
