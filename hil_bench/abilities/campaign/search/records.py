"""The settings and the results of a search."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from hil_bench.abilities.campaign.confidence import Tally
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.abilities.campaign.sampling import Point
from hil_bench.abilities.campaign.summary import size_of


class Method(StrEnum):
    """The methods by which a search chooses its runs."""

    RANDOM = "random"
    SOBOL = "sobol"
    CMA_ES = "cma-es"


ALL_METHODS = tuple(Method)


@dataclass(frozen=True, slots=True)
class Budget:
    """The budget of a search.

    Attributes:
        runs: of each method.
        minutes: on the machine's clock, for all of them; None for no matter.
    """

    runs: int = 200
    minutes: float | None = None


class Trial(NamedTuple):
    """A run of a search.

    Attributes:
        method: that chose it.
        number: of the run among those of the method, from 1.
        point: the values of the parameters.
        result: what came of it.
    """

    method: Method
    number: int
    point: Point
    result: RunResult

    def margin(self, requirement: str) -> float | None:
        """Return the margin of a requirement, 1 or -1 without a size; None of an undecided one."""
        found = self.result.verdict_on(requirement)
        return size_of(found) if found is not None and found.is_decided else None


class Find(NamedTuple):
    """The finding of a search on a requirement.

    Attributes:
        id: of the requirement.
        first: the first failure of each method, by its number; those that found none are missing.
        worst: the trial with the smallest margin; None where no run was decided.
        margin: that margin.
        tally: the runs by what they say of it.
    """

    id: str
    first: dict[Method, int]
    worst: Trial | None
    margin: float
    tally: Tally

    @property
    def is_failed(self) -> bool:
        """True if the requirement fails anywhere."""
        return bool(self.first)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The result of a search.

    Attributes:
        trials: in their order.
        finds: of each requirement, in the order of the file.
        has_ended_early: whether a method has done fewer runs than it had: by time, or by failures.
        is_interrupted: whether Ctrl-C or a signal ended it.
    """

    trials: tuple[Trial, ...]
    finds: tuple[Find, ...]
    has_ended_early: bool
    is_interrupted: bool = False

    @property
    def crashes(self) -> tuple[Trial, ...]:
        """Runs that did not come to their end."""
        return tuple(
            each for each in self.trials if each.result.problem and not each.result.verdicts
        )

    def of(self, method: Method) -> tuple[Trial, ...]:
        """Return the trials of a method."""
        return tuple(each for each in self.trials if each.method is method)
