"""A failure made small: nearer to the file's values, rounder numbers, a run that ends earlier.

It stays a failure that the author of the file would call one: its parameters lie in their ranges,
and its run is the beginning of one of the whole scenario, whose steps come as they did.
"""

import math
import os
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.campaign.distributions import Point
from hil_bench.abilities.campaign.records import RunOutcome, RunResult
from hil_bench.abilities.campaign.search import Method, Trial
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.reach import survives_a_cut
from hil_bench.abilities.scenario.reading import read_scenario, seconds
from hil_bench.abilities.scenario.records import LocatedProblems, Scenario, SetStep
from hil_bench.abilities.scenario.run import prepare
from hil_bench.abilities.scenario.usage import unused_parameters
from hil_bench.abilities.scenario.writing import to_toml
from hil_bench.errors import (
    ConfigError,
    about_file,
)

# A failure made small: nearer to the file's values, rounder numbers, a run that ends earlier.
#
# It stays a failure that the author of the file would call one: its parameters lie in their
# ranges, and its run is the beginning of one of the whole scenario, whose steps come as they did.

_HALVINGS = 6
_MOST_DIGITS = 4

Run = Callable[[Scenario], RunResult]
"""Plays a scenario with the values of its file; a `ConfigError` says that it cannot be."""


class Target(NamedTuple):
    """The failure that a shrunk run has to keep.

    Attributes:
        requirement: its id; empty for a run that does not come to its end.
        outcome: of such a run.
    """

    requirement: str
    outcome: RunOutcome = RunOutcome.FAILED

    def is_hit(self, result: RunResult) -> bool:
        """Return True if a run still fails."""
        if not self.requirement:
            return result.outcome is self.outcome
        verdict = result.verdict_on(self.requirement)
        return verdict is not None and verdict.is_failed


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
            shrinker.make_usual,
            shrinker.shorten,
            shrinker.make_smaller,
            shrinker.round_numbers,
            shrinker.shorten,
        ):
            part()
    except KeyboardInterrupt:
        found = shrinker.found or as_found(scenario, trial, target)
        return found._replace(is_interrupted=True)
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
        self._varied = {each.name: each for each in scenario.parameters if each.span is not None}
        self._whole, self._duration = scenario, scenario.duration
        self._target, self._run = target, run
        self._runs = 0
        self._found: tuple[Scenario, RunResult] | None = None

    @property
    def found(self) -> Shrunk | None:
        """The smallest failure found so far."""
        return None if self._found is None else Shrunk(*self._found, self._runs)

    def begin(self, point: Point) -> bool:
        """Take the values of the failure, and no other requirement; return whether it fails."""
        plain = _at(self._whole, point)
        alone = _alone(plain, self._target)
        return self._try(alone, self._duration) or self._try(plain, self._duration)

    def make_usual(self) -> None:
        """Give parameters the value of the file again."""
        for name, usual in self._varied.items():
            self._try(self._with(name, usual.value), self._duration)

    def shorten(self) -> None:
        """End the run earlier, where a sound controller passes the shorter run as well."""
        requirements = prepare(_tidied(self._whole)).requirements
        if not all(survives_a_cut(each.condition) for each in requirements):
            return
        low, high = 0.0, self._duration
        for _ in range(_HALVINGS):
            middle = round_to(0.5 * (low + high), 2)
            if not low < middle < high:
                return
            if self._try(self._whole, middle):
                high = middle
            else:
                low = middle

    def make_smaller(self) -> None:
        """Bring parameters nearer to the file's values."""
        for name, usual in self._varied.items():
            self._approach(self._value(name), usual.value, partial(self._with, name))

    def round_numbers(self) -> None:
        """Write numbers with fewer digits."""
        for name, usual in self._varied.items():
            value = self._value(name)
            for rounded in _rounder(value) if value != usual.value else ():
                if self._try(self._with(name, rounded), self._duration):
                    break

    def _approach(self, value: float, usual: float, change: Callable[[float], Scenario]) -> None:
        """Bring a number nearer to its usual value, by halving what is in doubt."""
        for _ in range(_HALVINGS):
            middle = 0.5 * (value + usual)
            if middle in {value, usual}:
                return
            if self._try(change(middle), self._duration):
                value = middle
            else:
                usual = middle

    def _value(self, name: str) -> float:
        return next(each.value for each in self._whole.parameters if each.name == name)

    def _with(self, name: str, value: float) -> Scenario:
        """Return the scenario with a value, which stays within its range."""
        low, high = self._varied[name].span or (value, value)
        inside = min(max(value, low), high)
        changed = (
            replace(each, value=inside) if each.name == name else each
            for each in self._whole.parameters
        )
        return replace(self._whole, parameters=tuple(changed))

    def _try(self, whole: Scenario, duration: float) -> bool:
        """Take a candidate that still fails, as its file will be read.

        Args:
            whole: the scenario with all its steps.
            duration: where its run ends [s].
        """
        candidate = _tidied(_cut(whole, duration))
        if self._found is not None and candidate == self._found[0]:
            return False
        try:
            result = self._run(_as_read(candidate))
        except ConfigError:
            return False
        self._runs += 1
        if not self._target.is_hit(result):
            return False
        self._whole, self._duration, self._found = whole, duration, (candidate, result)
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


def _cut(scenario: Scenario, duration: float) -> Scenario:
    """Return a scenario that ends earlier, without the steps behind its end."""
    parameters = {each.name: each for each in scenario.parameters}
    steps = tuple(each for each in scenario.steps if seconds(each.at, parameters) <= duration)
    return replace(scenario, duration=duration, steps=steps)


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


# A failure as files: a scenario, and a test of ten lines that plays it.

_TEST = '''\
"""{text}"""

from pathlib import Path

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare


def test_{name}():
    scenario = load_scenario(Path(__file__).with_name("{file}"))
    for found in play(prepare(scenario)).findings:
        assert found.judgement.outcome == "passed", found.judgement
'''


class Files(NamedTuple):
    """The files written.

    Attributes:
        scenario: plays the failure.
        test: does so under pytest.
    """

    scenario: Path
    test: Path


def write_failure(
    shrunk: Shrunk, target: Target, folder: Path, found_by: tuple[Method, int]
) -> Files:
    """Write a failure to files; what cannot be written is a `ConfigError`.

    Args:
        shrunk: the failure.
        target: what fails.
        folder: where to.
        found_by: the method that found it, and the number of its run.
    """
    source = shrunk.scenario
    stem = source.path.name.split(".")[0]
    name = re.sub(r"\W+", "_", f"{stem}_{target.requirement or 'crash'}").lower()
    files = Files(folder / f"{name}.scenario.toml", folder / f"test_{name}.py")
    what = f"{target.requirement} fails" if target.requirement else "The run does not end well"
    method, number = found_by
    text = f"{what}: found by hil-bench falsify in {source.path.name}, run {number} of {method}."
    with about_file(folder):
        folder.mkdir(parents=True, exist_ok=True)
        content = to_toml(_moved(source, folder))
        test = _TEST.format(text=text, name=name, file=files.scenario.name)
        with whole_file(files.scenario) as scenario, whole_file(files.test) as of_pytest:
            scenario.write_text(f"# {text}\n{content}", encoding="utf-8")
            of_pytest.write_text(test, encoding="utf-8")
    return files


def load_failure(files: Files) -> Scenario:
    """Return the scenario that was written."""
    return load_scenario(files.scenario)


def _moved(scenario: Scenario, folder: Path) -> Scenario:
    """Return a scenario whose files are named as seen from another folder."""

    def seen(name: str) -> str:
        return os.path.relpath(scenario.path.parent / name, folder)

    steps = tuple(
        replace(each, table=seen(each.table)) if isinstance(each, SetStep) and each.table else each
        for each in scenario.steps
    )
    title = f"{scenario.title}: a failure"
    bench = seen(scenario.bench) if scenario.bench else None
    ids = tuple(each.id for each in scenario.expectations)
    controller = scenario.controller
    if controller is not None and controller.table:
        of_files = seen(str(controller.table.get("folder", ".")))
        controller = replace(controller, table={**controller.table, "folder": of_files})
    moved = replace(scenario, title=title, bench=bench, steps=steps, controller=controller)
    return replace(moved, requirement_ids=ids)
