"""The records of a campaign, and how a folder of them is read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple, Self

from hil_bench.abilities.campaign import distributions
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.records import LocatedProblems, Scenario, find_spots
from hil_bench.config.document import Sort, Tables, read_document
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, describe, integer, number, text, texts
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

# A campaign as its file has it, a run to be done, and what came of it.


EACH = "each"
"""In the place of seeds: every point has a seed of its own."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """The description of a campaign.

    Attributes:
        path: its file; it names other files from there.
        title: in words.
        scenarios: files of scenarios.
        sampler: how points are chosen.
        runs: points of each scenario; a grid has as many as it has.
        levels: of a grid, values a parameter.
        seed: of the sampler.
        seeds: of the bench: each point is run with every one of them; empty for the bench's own.
        seed_each: whether each point has a seed of its own in their place.
        benches: files of benches in the place of the scenarios' own; empty for these.
        firmware: command lines in the place of the scenarios' own, by name.
        parameters: what values the scenarios' parameters take; others have the `range` of the file.
        tolerances: what values keys of the bench take, by their place as in
            ``plant.axis1.mass_kg``.
        timeout: how long a run may take, on the machine's clock [s].
        given: values of the scenarios' parameters, which then do not vary.
    """

    path: Path
    scenarios: tuple[Path, ...]
    title: str = ""
    sampler: distributions.Sampler = distributions.Sampler.SOBOL
    runs: int = 64
    levels: int = 5
    seed: int = 0
    seeds: tuple[int, ...] = ()
    seed_each: bool = False
    benches: tuple[Path, ...] = ()
    firmware: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, distributions.Distribution] = field(default_factory=dict)
    tolerances: Mapping[str, distributions.Distribution] = field(default_factory=dict)
    timeout: float = 60.0
    given: distributions.Point = field(default_factory=dict)

    def changed(
        self,
        *,
        runs: int | None,
        sampler: str | None,
        seed: int | None,
        given: Mapping[str, float] | None = None,
    ) -> Self:
        """Return the campaign with other values in the place of the file's; None changes nothing.

        Args:
            runs: points of each scenario.
            sampler: the name of one.
            seed: of the sampler.
            given: values of parameters.
        """
        changes: dict[str, Any] = {"runs": runs, "seed": seed, "given": given}
        changes["sampler"] = None if sampler is None else distributions.Sampler(sampler)
        return replace(self, **{k: value for k, value in changes.items() if value is not None})


class Case(NamedTuple):
    """A scenario on a bench with a controller: what all runs of a group have in common.

    Attributes:
        name: of the scenario, as the campaign names it.
        bench: of the bench, likewise; empty for the scenario's own.
        firmware: of the firmware, likewise.
        scenario: with that bench, by its absolute path, and that firmware.
        digest: of all that decides what its runs find, but parameters and seed.
    """

    name: str
    bench: str
    firmware: str
    scenario: Scenario
    digest: str


class RunSpec(NamedTuple):
    """A run to be done.

    Attributes:
        key: the digest of all below.
        case: what is run.
        parameters: of the scenario, each in its own unit.
        tolerances: keys of the bench with their values.
        seed: of the bench; None for the bench's own.
        timeout: how long it may take [s].
    """

    key: str
    case: Case
    parameters: distributions.Point
    tolerances: distributions.Point
    seed: int | None
    timeout: float

    @property
    def values(self) -> distributions.Point:
        """All that was varied."""
        return {**self.parameters, **self.tolerances}


class RunOutcome(StrEnum):
    """The outcome of a run: the worst of its requirements, where it came to its end."""

    PASSED = "passed"
    NOT_EXERCISED = "not exercised"
    INCONCLUSIVE = "inconclusive"
    FAILED = "failed"
    TIMED_OUT = "timed out"
    CRASHED = "crashed"

    @property
    def is_failure(self) -> bool:
        """True if the outcome shows that something is wrong."""
        return self is RunOutcome.FAILED or self.is_cut_off

    @property
    def is_cut_off(self) -> bool:
        """True if the run did not come to its end."""
        return self in {RunOutcome.TIMED_OUT, RunOutcome.CRASHED}


class Verdict(NamedTuple):
    """The verdict of a run on a requirement.

    Attributes:
        id: of the requirement.
        outcome: as `RequirementOutcome` has it.
        margin: as a share of the tolerance; None where it is unknown or has no size.
        reason: why, in a line.
        seen: how much of its time the run showed, 0 to 1; None in results of versions before.
    """

    id: str
    outcome: str
    margin: float | None
    reason: str
    seen: float | None = None

    @property
    def is_failed(self) -> bool:
        """True if the run failed the requirement."""
        return self.outcome == RequirementOutcome.FAILED

    @property
    def is_decided(self) -> bool:
        """True if the run passed or failed the requirement."""
        return self.is_failed or self.outcome == RequirementOutcome.PASSED

    @property
    def decided_margin(self) -> float | None:
        """The margin of a decided requirement; None where it has no size."""
        return self.margin if self.is_decided else None


class RunResult(NamedTuple):
    """The result of a run.

    Attributes:
        key: of the run.
        scenario: the name of the scenario.
        bench: of the bench; empty for the scenario's own.
        firmware: likewise.
        seed: of the bench; None for the bench's own.
        values: what was varied, in the units of the names.
        outcome: of the run.
        problem: why it did not come to its end; empty where it did.
        duration: of the run, in bench time [s].
        verdicts: on each requirement; empty where it did not come to its end.
    """

    key: str
    scenario: str
    bench: str
    firmware: str
    seed: int | None
    values: distributions.Point
    outcome: RunOutcome
    problem: str = ""
    duration: float = 0.0
    verdicts: tuple[Verdict, ...] = ()

    def verdict_on(self, requirement: str) -> Verdict | None:
        """Return the verdict on a requirement; None without one."""
        return next((each for each in self.verdicts if each.id == requirement), None)

    def outcome_of(self, requirement: str) -> str:
        """Return the outcome of a requirement; of the run, where it did not come to its end."""
        found = self.verdict_on(requirement)
        return self.outcome.value if found is None else found.outcome


# `campaign.toml` to a record; a scenario's file is a campaign by itself.


_TABLES = ("firmware", "parameters", "tolerances")
_MOST_RUNS = 10_000_000
_MOST_LEVELS = 1000


def read_campaign(path: Path) -> Campaign:
    """Return the campaign of a file; of a scenario, a campaign of it alone.

    Whatever is wrong comes as one `ConfigError`, a line a problem, with line and column.
    """
    if path.suffix.lower() == ".csv":
        return Campaign(path, (path,))
    document = read_document(path, Sort.CAMPAIGN, Sort.SCENARIO)
    if path.name.endswith(".scenario.toml") or "expect" in document:
        return Campaign(path, (path,))
    problems = LocatedProblems(str(path), find_spots(path.read_text(encoding="utf-8-sig")))
    file = Tables(document, problems)
    found = file.head(_KEYS, _TABLES)
    firmware = file.entries("firmware", _command)
    parameters = file.entries("parameters", distributions.read_distribution)
    tolerances = file.entries("tolerances", distributions.read_distribution)
    problems.raise_any()
    value = {name: setting.value for name, setting in found.items()}
    seeds = value["seeds"]
    return Campaign(
        path,
        tuple(path.parent / each for each in value["scenarios"]),
        title=value["title"],
        sampler=value["sampler"],
        runs=value["runs"],
        levels=value["levels"],
        seed=value["seed"],
        seeds=() if seeds == EACH else seeds,
        seed_each=seeds == EACH,
        benches=tuple(path.parent / each for each in value["benches"]),
        firmware=firmware,
        parameters=parameters,
        tolerances=tolerances,
        timeout=value["timeout_s"],
    )


def _some(value: object) -> tuple[str, ...]:
    found = texts(value)
    if not found:
        raise ConfigError("is empty; give one or more")
    if len(set(found)) < len(found):
        raise ConfigError("names one twice; give each once")
    return found


def _command(value: object) -> tuple[str, ...]:
    words = texts(value)
    if not words:
        right = 'give a command line, as in ["build/controller", "{bus}"]'
        raise ConfigError(f"is empty; {right}")
    return words


def _seeds(value: object) -> tuple[int, ...] | str:
    if value == EACH:
        return EACH
    if not isinstance(value, list) or not value:
        right = f'give a list of integers, or "{EACH}" for a seed of its own for each point'
        raise ConfigError(f"{describe(value)} is no list of seeds; {right}")
    return tuple(integer(0)(each) for each in value)


_KEYS: Sequence[Key] = (
    Key("title", text, ""),
    Key("scenarios", _some, example='["sag.scenario.toml"]'),
    Key("sampler", choice(distributions.Sampler), distributions.Sampler.SOBOL),
    Key("runs", integer(1, _MOST_RUNS), 64),
    Key("levels", integer(1, _MOST_LEVELS), 5),
    Key("seed", integer(0), 0),
    Key("seeds", _seeds, ()),
    Key("benches", _some, ()),
    Key("timeout_s", number(SECOND, low=0.1, high=1e6), 60.0, SECOND),
)
