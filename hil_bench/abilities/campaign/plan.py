"""The runs of a campaign, in one order: cases, then points, then seeds."""

import logging
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.abilities.campaign import distributions
from hil_bench.abilities.campaign.records import Campaign, Case, RunSpec
from hil_bench.abilities.campaign.store import (
    case_digest,
    controller_digest,
    firmware_digest,
    run_key,
)
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.records import Controller, Parameter, Scenario
from hil_bench.abilities.scenario.resolve import parameter_values
from hil_bench.abilities.scenario.run import prepare
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.results import warn_of
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError

logger = logging.getLogger(__name__)

_FEWEST_BLOCKS = 8  # of Saltelli's design: fewer say nothing

Space = dict[str, distributions.Distribution]
"""The distribution of each parameter."""


class Group(NamedTuple):
    """A case with the space that its runs are drawn from.

    Attributes:
        case: what is run.
        space: of the scenario's parameters.
    """

    case: Case
    space: Space


class Plan:
    """All runs of a campaign.

    Args:
        campaign: which.

    Attributes:
        campaign: likewise.
        groups: the cases.
        firmware: the digest of each firmware by its name; empty for the scenarios' own.

    Raises:
        ConfigError: a scenario, a bench or a firmware does not fit; a line a problem.
    """

    def __init__(self, campaign: Campaign) -> None:
        _check_design(campaign)
        self.campaign = campaign
        self.firmware: dict[str, str] = {}
        self.groups = tuple(self._warn_once(self._groups()))

    def __len__(self) -> int:
        campaign = self.campaign
        return sum(
            distributions.size_of_sample(
                list(self._varied(group).values()), campaign.sampler, campaign.runs, campaign.levels
            )
            * len(self._seeds(group, 0))
            for group in self.groups
        )

    def __iter__(self) -> Iterator[RunSpec]:
        for group in self.groups:
            yield from self.runs_of(group)

    def runs_of(self, group: Group) -> Iterator[RunSpec]:
        """Yield the runs of a case."""
        campaign = self.campaign
        points = distributions.sample(
            self._varied(group),
            campaign.sampler,
            campaign.runs,
            campaign.seed,
            levels=campaign.levels,
        )
        for number, point in enumerate(points):
            for seed in self._seeds(group, number):
                yield make_spec(group.case, point, group.space, seed, campaign.timeout)

    def _seeds(self, group: Group, point: int) -> Sequence[int | None]:
        """Return the seeds of a point; the only one of a case without a range has `runs`."""
        if not self.campaign.seed_each:
            return self.campaign.seeds or (None,)
        return (point,) if self._varied(group) else range(self.campaign.runs)

    def _varied(self, group: Group) -> Space:
        return {**group.space, **self.campaign.tolerances}

    def _groups(self) -> Iterator[Group]:
        campaign = self.campaign
        scenarios = {
            path: fix_parameters(load_scenario(path), campaign.given) for path in campaign.scenarios
        }
        _check_names(campaign, scenarios)
        names = dict(zip(scenarios, short_names(scenarios), strict=True))
        benches = dict(zip(campaign.benches, short_names(campaign.benches), strict=True))
        drawn = {k: each for k, each in campaign.parameters.items() if k not in campaign.given}
        for path, scenario in scenarios.items():
            space = space_of(scenario, drawn, campaign.path)
            varied = [*space.values(), *campaign.tolerances.values()]
            has_seeds = campaign.seeds or campaign.seed_each
            if not has_seeds and all(len({*each.bounds}) == 1 for each in varied):
                raise ConfigError(no_range(scenario))
            for bench, controller in _variants(campaign, scenario):
                changed = replace(scenario, bench=_absolute(bench or scenario.bench_path))
                changed = replace(changed, controller=controller[1])
                self._note_firmware(controller)
                name = benches[bench] if bench else ""
                case = make_case(changed, names[path], name, controller[0])
                _try_ends(case, space, campaign.tolerances)
                yield Group(case, space)

    @staticmethod
    def _warn_once(groups: Iterator[Group]) -> Iterator[Group]:
        """Yield cases; say each of their warnings once behind them, with the number of cases."""
        times = Counter[str]()
        try:
            while True:
                with _kept_warnings() as texts:
                    try:
                        group = next(groups, None)
                    finally:
                        times.update(dict.fromkeys(texts, 1))
                if group is None:
                    return
                yield group
        finally:
            for text, count in times.items():
                logger.warning("%s%s", text, f" (in {count} variants)" * (count > 1))

    def _note_firmware(self, controller: tuple[str, Controller | None]) -> None:
        name, record = controller
        if record is not None and record.firmware:
            self.firmware[name or " ".join(record.firmware)] = firmware_digest(record.firmware)


def make_case(scenario: Scenario, name: str, bench: str = "", firmware: str = "") -> Case:
    """Return the case of a scenario, checked against its bench.

    Args:
        scenario: with an absolute path to its bench.
        name: of the scenario.
        bench: how the bench is named.
        firmware: how the firmware is named.
    """
    prepared = prepare(scenario)
    warn_of(prepared.doubts)
    _check_storage(prepared.config)
    files = controller_digest(scenario.controller, scenario.path.parent)
    digest = case_digest(scenario, prepared.config, files)
    return Case(name, bench, firmware, scenario, digest)


def make_spec(
    case: Case,
    point: distributions.Point,
    space: Mapping[str, object],
    seed: int | None,
    timeout: float,
) -> RunSpec:
    """Return a run.

    Args:
        case: what is run.
        point: a value of each parameter, and of each key of the bench that varies.
        space: the names of those that are parameters of the scenario.
        seed: of the bench; None for its own.
        timeout: how long it may take [s].
    """
    fixed = {each.name: each.value for each in case.scenario.parameters}
    given = {name: value for name, value in point.items() if name in space}
    tolerances = {name: value for name, value in point.items() if name not in space}
    key = run_key(case.digest, fixed | given, tolerances, seed)
    return RunSpec(key, case, given, tolerances, seed, timeout)


def own_case(scenario: Scenario) -> Case:
    """Return the case of a scenario as its file has it, on its own bench."""
    bench = _absolute(scenario.bench_path)
    return make_case(replace(scenario, bench=bench), short_names([scenario.path])[0])


def fix_parameters(scenario: Scenario, given: Mapping[str, float]) -> Scenario:
    """Return a scenario some of whose parameters have other values, and do not vary.

    Args:
        scenario: whose parameters.
        given: values in the parameters' own units; one for no parameter is a `ConfigError`.
    """
    parameter_values(scenario, given)
    parameters = tuple(
        replace(each, value=given[each.name], span=None) if each.name in given else each
        for each in scenario.parameters
    )
    return replace(scenario, parameters=parameters)


def space_of(
    scenario: Scenario,
    given: Mapping[str, distributions.Distribution] | None = None,
    source: Path | str = "",
) -> Space:
    """Return the distributions of a scenario's parameters, of those that vary.

    Args:
        scenario: whose parameters; each with a `range` varies.
        given: distributions that take the place of ranges; a normal one ends at the range.
        source: the file that gives them, for messages.
    """
    space: Space = {}
    for each in scenario.parameters:
        found = (given or {}).get(each.name)
        if found is not None:
            space[each.name] = _within(found, each, f"{source}: parameters.{each.name}", scenario)
        elif each.span is not None:
            space[each.name] = distributions.Uniform(*each.span)
    return space


def no_range(scenario: Scenario) -> str:
    """Return the message that nothing in a scenario varies."""
    example = "target_mm = { value = 100.0, range = [20.0, 180.0] }"
    return f"{scenario.path}: no parameter has a range; give one, as in {example}"


def nested(tolerances: distributions.Point) -> dict[str, object]:
    """Return keys such as ``plant.axis1.mass_kg`` as tables in tables."""
    tables: dict[str, Any] = {}
    for name, value in tolerances.items():
        *path, key = name.split(".")
        table = tables
        for part in path:
            table = table.setdefault(part, {})
        table[key] = value
    return tables


def short_names(paths: "list[Path] | tuple[Path, ...] | Mapping[Path, object]") -> list[str]:
    """Return a name for each file: its own without suffixes; with its folder where two have one."""
    stems = [each.name.split(".")[0] for each in paths]
    return [
        stem if stems.count(stem) == 1 else f"{each.parent.name}/{stem}"
        for stem, each in zip(stems, paths, strict=True)
    ]


def _within(
    found: distributions.Distribution, parameter: Parameter, place: str, scenario: Scenario
) -> distributions.Distribution:
    if parameter.span is None:
        return found
    low, high = parameter.span
    if isinstance(found, distributions.Normal):
        return replace(found, low=low, high=high)
    if found.bounds[0] < low or found.bounds[1] > high:
        wrong = f"{found.bounds[0]:g} to {found.bounds[1]:g} leaves the range {low:g} to {high:g}"
        right = "stay in it, or widen it there"
        raise ConfigError(f"{place}: {wrong} of {scenario.path}; {right}")
    return found


def _check_design(campaign: Campaign) -> None:
    """Refuse what Saltelli's design cannot be made of, or not be read from.

    Raises:
        ConfigError: the number of points is no power of two, or a point has several seeds.
    """
    if campaign.sampler is not distributions.Sampler.SALTELLI:
        return
    runs = campaign.runs
    if runs & (runs - 1) or runs < _FEWEST_BLOCKS:
        near = max(1 << runs.bit_length(), _FEWEST_BLOCKS)
        wrong = (
            f"runs = {runs}: the sampler saltelli needs a power of two, {_FEWEST_BLOCKS} or more"
        )
        raise ConfigError(f"{campaign.path}: {wrong}; give {near}")
    if campaign.seed_each or len(campaign.seeds) > 1:
        wrong = "the sampler saltelli compares a point with its neighbours"
        raise ConfigError(f"{campaign.path}: seeds: {wrong}; give one seed, or none")


def _check_names(campaign: Campaign, scenarios: Mapping[Path, Scenario]) -> None:
    known = {each.name for scenario in scenarios.values() for each in scenario.parameters}
    for name in campaign.parameters:
        if name not in known:
            right = f"the nearest is {find_nearest(name, known)}" if known else "there are none"
            wrong = f"{quote(name)} is no parameter of the scenarios; {right}"
            raise ConfigError(f"{campaign.path}: parameters.{name}: {wrong}")


def _variants(
    campaign: Campaign, scenario: Scenario
) -> Iterator[tuple[Path | None, tuple[str, Controller | None]]]:
    """Yield each bench with each controller, the scenario's own where there are no others.

    Raises:
        ConfigError: the campaign has firmware, and the scenario none to be replaced.
    """
    controllers: list[tuple[str, Controller | None]] = [("", scenario.controller)]
    if campaign.firmware:
        if scenario.controller is None or not scenario.controller.firmware:
            wrong = "has no firmware, and the campaign has [firmware]"
            raise ConfigError(f"{scenario.path}: {wrong}; give one in [controller]")
        controllers = [(name, Controller(words)) for name, words in campaign.firmware.items()]
    for bench in campaign.benches or (None,):
        for controller in controllers:
            yield bench, controller


def _try_ends(
    case: Case, space: Space, tolerances: Mapping[str, distributions.Distribution]
) -> None:
    """Refuse what varies where its least or largest value makes no bench or no run."""
    for name, each in chain(space.items(), tolerances.items()):
        for bound in each.bounds:
            if math.isfinite(bound):
                is_tolerance = name not in space
                tables = nested({name: bound}) if is_tolerance else {}
                prepare(case.scenario, {} if is_tolerance else {name: bound}, tables=tables)


def _check_storage(config: BenchConfig) -> None:
    for node in config.nodes:
        if node.storage is not None:
            wrong = "a node that stores its parameters in files carries them from run to run"
            raise ConfigError(f"{node.place}.storage: {wrong}; take the key out for campaigns")


def _absolute(path: Path | None) -> str | None:
    return str(path.resolve()) if path else None


@contextmanager
def _kept_warnings() -> Iterator[list[str]]:
    """Keep the warnings of this package within the block, in place of saying them.

    Yields:
        Their texts, as they come.
    """
    ours = logging.getLogger("hil_bench")
    keeper = _Keeper()
    ours.addHandler(keeper)
    ours.propagate = False
    try:
        yield keeper.texts
    finally:
        ours.propagate = True
        ours.removeHandler(keeper)


class _Keeper(logging.Handler):
    """Keeps warnings, and hands on what is none."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Take a record."""
        if record.levelno < logging.WARNING:
            logging.getLogger().handle(record)
        else:
            self.texts.append(record.getMessage())
