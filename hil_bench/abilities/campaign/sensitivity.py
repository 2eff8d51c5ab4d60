"""Sobol indices of the margins, of a campaign with Saltelli's design."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.campaign.distributions import Floats, Sampler
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult

_RESAMPLES = 999
_CONFIDENCE = 0.95
_MATTERS = 0.01  # total share below which a parameter is left out of a line


class Estimate(NamedTuple):
    """An index with its 95 % confidence interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


class SobolIndices(NamedTuple):
    """The share of a margin's variance that comes from a parameter.

    Attributes:
        scenario: its name.
        bench: as the campaign names it; empty for the scenario's own.
        firmware: likewise.
        requirement: whose margin.
        parameter: which.
        first: the share that the parameter has by itself.
        total: the share that it has with all that it acts together with.
    """

    scenario: str
    bench: str
    firmware: str
    requirement: str
    parameter: str
    first: Estimate
    total: Estimate

    @property
    def matters(self) -> bool:
        """True if the parameter's total share is a hundredth of the variance or more."""
        return self.total.value >= _MATTERS

    def name(self) -> str:
        """Return the names of the case and the requirement."""
        return f"{_case_name(self.scenario, self.bench, self.firmware)}  {self.requirement}"

    def content(self) -> dict[str, object]:
        """Return it for a JSON file."""
        return {**self._asdict(), "first": self.first._asdict(), "total": self.total._asdict()}


class Sensitivity(NamedTuple):
    """The results of Saltelli's design.

    Attributes:
        indices: of each requirement, the largest total share first.
        gaps: the requirements for which nothing can be computed, and why; a line each.
    """

    indices: tuple[SobolIndices, ...]
    gaps: tuple[str, ...]

    def lines(self) -> Iterator[str]:
        """Yield a line a requirement, for people: the parameters that matter, and the gaps."""
        for name, found in groupby(self.indices, SobolIndices.name):
            shares = [f"{each.parameter} {each.total}" for each in found if each.matters]
            yield f"{name}: shares of the margin's variance: {', '.join(shares)}"
        yield from (f"{line}, so there are no Sobol indices" for line in self.gaps)


def sobol_indices(plan: Plan, results: Sequence[RunResult]) -> Sensitivity:
    """Return the Sobol indices of all margins; nothing for any other sampler than Saltelli's.

    The estimators are those of Saltelli et al. (2010), Computer Physics Communications 181,
    259-270; the intervals are bootstrapped.

    Args:
        plan: the campaign.
        results: of its runs.
    """
    indices: list[SobolIndices] = []
    gaps: list[str] = []
    if plan.campaign.sampler is Sampler.SALTELLI:
        found = {result.key: result for result in results}
        for group in plan.groups:
            specs = list(plan.runs_of(group))
            done = [found[spec.key] for spec in specs if spec.key in found]
            names = list(specs[0].values)
            name = _case_name(group.case.name, group.case.bench, group.case.firmware)
            for requirement in [each.id for each in group.case.scenario.expectations]:
                table = _margins(done, requirement)
                if len(table) < len(specs):
                    lack = f"{len(specs) - len(table)} of {len(specs)} runs have no margin"
                    gaps.append(f"{name}  {requirement}: {lack}")
                elif np.ptp(table) == 0.0:
                    gaps.append(f"{name}  {requirement}: all margins are the same")
                else:
                    case = group.case
                    for parameter, (first, total) in _estimate(names, table).items():
                        key = case.name, case.bench, case.firmware, requirement, parameter
                        indices.append(SobolIndices(*key, first, total))
    return Sensitivity(tuple(sorted(indices, key=_order)), tuple(gaps))


def _case_name(*parts: str) -> str:
    return " ".join(filter(None, parts))


def _order(each: SobolIndices) -> tuple[str, str, str, str, float]:
    return each.scenario, each.bench, each.firmware, each.requirement, -each.total.value


def _margins(results: Sequence[RunResult], requirement: str) -> Floats:
    return np.array(list(_known(results, requirement)), dtype=np.float64)


def _known(results: Sequence[RunResult], requirement: str) -> Iterator[float]:
    for result in results:
        for verdict in result.verdicts:
            if verdict.id == requirement and verdict.decided_margin is not None:
                yield verdict.decided_margin


def _estimate(names: Sequence[str], margins: Floats) -> Mapping[str, tuple[Estimate, Estimate]]:
    """Return first and total index of each parameter from the margins in the design's order."""
    blocks = margins.reshape(-1, len(names) + 2)
    generator = np.random.default_rng(0)
    drawn = generator.integers(len(blocks), size=(_RESAMPLES, len(blocks)))
    spread = np.array([_shares(blocks[rows]) for rows in drawn])
    tail = 50.0 * (1.0 - _CONFIDENCE)
    low, high = np.nanpercentile(spread, (tail, 100.0 - tail), axis=0)
    table = np.stack((_shares(blocks), low, high), axis=-1).tolist()
    pairs = ((Estimate(*first), Estimate(*total)) for first, total in zip(*table, strict=True))
    return dict(zip(names, pairs, strict=True))


def _shares(blocks: Floats) -> Floats:
    """Return first and total indices, shape (2, parameters): Saltelli et al. (2010), table 2.

    Args:
        blocks: the margins of A, of B and of A with each parameter of B, shape
            (blocks, parameters + 2).
    """
    centred = blocks - blocks[:, :2].mean()
    a, b, mixed = centred[:, :1], centred[:, 1:2], centred[:, 2:]
    variance = centred[:, :2].var()
    if variance == 0.0:  # of a resample
        return np.full((2, mixed.shape[1]), np.nan)
    first = (b * (mixed - a)).mean(axis=0) / variance
    total = 0.5 * ((a - mixed) ** 2).mean(axis=0) / variance
    return np.stack((first, total))
