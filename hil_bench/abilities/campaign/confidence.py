"""Confidence bounds on a probability after a number of runs."""

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from typing import NamedTuple, Self

CONFIDENCE = 0.95


def failure_bound(failures: int, runs: int, confidence: float = CONFIDENCE) -> float:
    """Return the upper bound on a probability, one-sided (Clopper and Pearson, Biometrika 1934).

    It is exact for independent runs: with the true probability above it, as few failures come with
    a probability of at most 1 - `confidence`.

    Args:
        failures: how many runs failed.
        runs: how many there were.
        confidence: of the bound, from 0 to 1.
    """
    if failures >= runs:
        return 1.0
    if failures == 0:
        return float(1.0 - (1.0 - confidence) ** (1.0 / runs))
    from scipy.stats import beta  # noqa: PLC0415 - an extra, and slow to import

    return float(beta.ppf(confidence, failures + 1, runs - failures))


class Tally(NamedTuple):
    """Runs by what they say; those that are not decided bear on no probability.

    Attributes:
        passed: runs.
        failed: likewise.
        undecided: the number of all other runs by their outcome.
    """

    passed: int
    failed: int
    undecided: Mapping[str, int]

    @classmethod
    def of(cls, outcomes: Iterable[str], passing: str, failing: Container[str]) -> Self:
        """Count runs.

        Args:
            outcomes: of each run.
            passing: the outcome of a run that passed.
            failing: those of one that failed.
        """
        counts = Counter(outcomes)
        failed = sum(count for outcome, count in counts.items() if outcome in failing)
        others = {k: n for k, n in counts.items() if k != passing and k not in failing}
        return cls(counts[passing], failed, others)

    @property
    def decided(self) -> int:
        """The number of runs that passed or failed."""
        return self.passed + self.failed

    @property
    def runs(self) -> int:
        """The number of all runs."""
        return self.decided + sum(self.undecided.values())

    def runs_text(self, kind: str = "runs") -> str:
        """Say how many of how many runs are decided, as in "24 decided runs of 30 (6 crashed)"."""
        if not self.undecided:
            return f"{self.runs} {kind}"
        others = ", ".join(f"{count} {outcome}" for outcome, count in self.undecided.items())
        return f"{self.decided} decided {kind} of {self.runs} ({others})"

    def failures_text(self) -> str:
        """Say how many runs failed, of how many."""
        word = "failure" if self.failed < 2 else "failures"
        return f"{self.failed or 'no'} {word} in {self.runs_text()}"

    def bound_text(self) -> str:
        """Say the bound on the failure probability, which decided runs alone have."""
        if not self.decided:
            return "so there is no bound on the failure probability"
        of_what = " of decided runs" if self.undecided else ""
        return (
            f"{CONFIDENCE:.0%} upper bound on the failure probability{of_what} under the sampled "
            f"distribution {failure_bound(self.failed, self.decided):.2g}"
        )
