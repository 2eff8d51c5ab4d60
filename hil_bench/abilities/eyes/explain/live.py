"""Causes that come and go on a bus that goes on."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.explain.explain import Explainer
from hil_bench.abilities.eyes.explain.finding import Finding

_EVERY: Final = 500_000_000
"""Time between two looks [ns]."""


class Change(NamedTuple):
    """A cause that has come, or is gone.

    Attributes:
        now: when that was noticed [ns].
        finding: the cause.
        is_gone: whether it no longer explains what is on the bus.
    """

    now: int
    finding: Finding
    is_gone: bool


class LiveFindings:
    """Looks now and then what an explainer says, and keeps it.

    Args:
        explainer: takes the frames.

    Attributes:
        findings: the causes of the last look.
    """

    def __init__(self, explainer: Explainer) -> None:
        self._explainer = explainer
        self._look_at = _EVERY
        self.findings: tuple[Finding, ...] = ()

    def look(self, now: int) -> Iterator[Change]:
        """Yield the causes that have come or gone, twice a second.

        Args:
            now: the time, from the first frame on [ns].

        Yields:
            The changes.
        """
        if now < self._look_at:
            return
        self._look_at = now + _EVERY
        before = {_key(each): each for each in self.findings}
        self.findings = self._explainer.explanation(now).findings
        present = {_key(each) for each in self.findings}
        for finding in self.findings:
            if _key(finding) not in before:
                yield Change(now, finding, is_gone=False)
        for key, finding in before.items():
            if key not in present:
                yield Change(now, finding, is_gone=True)


def _key(finding: Finding) -> tuple[str, str]:
    return finding.cause.name, finding.node
