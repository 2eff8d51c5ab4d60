"""Two campaigns side by side: before and after a change of firmware, bench or program."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.campaign.records import RunResult, Verdict
from hil_bench.abilities.campaign.summary import show_point
from hil_bench.errors import ConfigError


class Change(NamedTuple):
    """The change of a requirement between two campaigns.

    Attributes:
        scenario: its name.
        id: of the requirement.
        runs: how many both campaigns have.
        broken: runs that fail it now, and did not before.
        mended: runs that failed it before, and pass it now.
        undecided: how many runs either campaign did not decide.
        margins: median of the margins of those that both decided, before and now; None where
            there are none.
    """

    scenario: str
    id: str
    runs: int
    broken: tuple[RunResult, ...]
    mended: tuple[RunResult, ...]
    undecided: int
    margins: tuple[float, float] | None

    def line(self) -> str:
        """Return it in a line."""
        counts = f"{len(self.broken)} newly failed, {len(self.mended)} no longer"
        line = f"{self.scenario}  {self.id}: of {self.runs} common runs {counts}"
        if self.undecided:
            line += f", {self.undecided} not decided before or now"
        if self.margins is not None:
            line += f"; median margin {self.margins[0]:+.3g} before, {self.margins[1]:+.3g} now"
        if self.broken:
            line += f"; first at {show_point(self.broken[0].values)}"
        return line


def compare(before: Iterable[RunResult], now: Sequence[RunResult]) -> list[Change]:
    """Return the changes between two campaigns, requirement by requirement.

    Runs are the same where scenario, bench, seed and values are; firmware may have another name.

    Args:
        before: the results of the first campaign.
        now: of the second.

    Raises:
        ConfigError: the campaigns have no run in common.
    """
    old = {_place(each): each for each in before}
    pairs = [(old[_place(each)], each) for each in now if _place(each) in old]
    if not pairs:
        raise ConfigError("--compare: no run is in both campaigns; sample with the same seed")
    names = dict.fromkeys(
        (each.scenario, one.id)
        for pair in pairs
        for each in reversed(pair)
        for one in each.verdicts
    )
    return [_change(*name, pairs) for name in names]


def _change(
    scenario: str, requirement: str, pairs: Sequence[tuple[RunResult, RunResult]]
) -> Change:
    found = [
        (old, new, result)
        for before, result in pairs
        if result.scenario == scenario
        and (old := _verdict(before, requirement)) is not None
        and (new := _verdict(result, requirement)) is not None
    ]
    decided = [each for each in found if each[0].is_decided and each[1].is_decided]
    broken = [each for old, new, each in found if new.is_failed and not old.is_failed]
    mended = [each for old, new, each in decided if old.is_failed and not new.is_failed]
    sized = [
        (old.margin, new.margin)
        for old, new, _ in decided
        if old.margin is not None and new.margin is not None
    ]
    margins = None
    if sized:
        first, second = (float(np.median(column)) for column in zip(*sized, strict=True))
        margins = first, second
    undecided = len(found) - len(decided)
    counts = len(found), tuple(broken), tuple(mended), undecided
    return Change(scenario, requirement, *counts, margins)


def _verdict(result: RunResult, requirement: str) -> Verdict | None:
    """Return the verdict of a run, undecided where the run was cut off; None without such one."""
    if result.outcome.is_cut_off:
        return Verdict(requirement, result.outcome.value, None, result.problem)
    return result.verdict_on(requirement)


def _place(result: RunResult) -> tuple[object, ...]:
    return result.scenario, result.bench, result.seed, *sorted(result.values.items())
