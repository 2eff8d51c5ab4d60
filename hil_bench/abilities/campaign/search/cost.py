"""The cost that a search minimises: the margin of the requirement of its turn."""

from collections.abc import Iterable, Sequence

from hil_bench.abilities.campaign.records import RunResult, Verdict
from hil_bench.abilities.campaign.summary import size_of

CRASH = -2.0
"""Cost of a run that did not come to its end: it shows that something is wrong."""

UNKNOWN = 2.0
"""Cost of a requirement that was not decided, or whose trigger never came: look elsewhere."""


def cost_of(result: RunResult, wanted: Iterable[str]) -> float:
    """Return the smallest margin among some requirements.

    Margins are shares of tolerances, so that those of pressures and of positions have one scale.

    Args:
        result: of a run.
        wanted: the requirements.
    """
    if result.outcome.is_cut_off:
        return CRASH
    ids = set(wanted)
    return min((_cost(each) for each in result.verdicts if each.id in ids), default=UNKNOWN)


def turns(requirements: Sequence[str], failed: Iterable[str]) -> Sequence[Sequence[str]]:
    """Return the requirements that the restarts of a search minimise, in turn.

    First all that have not failed yet, of which the worst leads; then each of them alone, so that
    one with a small margin that never fails starves none of the others.

    Args:
        requirements: all.
        failed: those for which a failure is known.
    """
    known = set(failed)
    open_ones = [each for each in requirements if each not in known]
    if len(open_ones) < 2:
        return [open_ones or requirements]
    return [open_ones, *([each] for each in open_ones)]


def _cost(verdict: Verdict) -> float:
    size = size_of(verdict)
    return size if verdict.is_decided else max(UNKNOWN, size)
