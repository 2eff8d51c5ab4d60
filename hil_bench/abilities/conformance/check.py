"""A check of the suite, and its possible ends.

Clauses are those of CiA 301 version 4.2.0. CiA 305 is cited by the name of the service.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from itertools import pairwise
from statistics import median

from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation


class Impact(IntEnum):
    """The impact of a check on the device."""

    READ = 0
    """Reads and listens; sends nothing that asks for a change."""
    WRITE = 1
    """Writes objects and restores them, resets, starts and stops the node, sends it PDOs."""
    STORE = 2
    """Overwrites the parameters that the device has stored."""


class Degree(StrEnum):
    """The weight that a clause has."""

    REQUIRED = "required"
    """Every CANopen device does this."""
    OPTIONAL = "optional"
    """A device may leave the service out; one that has it does this."""
    RECOMMENDED = "recommended"
    """The clause leaves it open, and most devices do this. One that does not is no failure."""


Judge = Callable[[DeviceUnderTest], str | None]
"""Does the check. Returns what else is worth telling; raises `Deviation` or `NotApplicable`."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that a clause asks for.

    Attributes:
        clause: where it stands.
        text: what is right, in a line.
        impact: what the check does to the device.
        judge: does it.
        degree: the weight of the clause.
    """

    clause: str
    text: str
    impact: Impact
    judge: Judge
    degree: Degree = Degree.REQUIRED


class Chapter:
    """The checks of one subject, in the order in which they are done.

    Attributes:
        title: the subject.
        degree: the degree of a check that names no other.
        impact: likewise.
        checks: its checks.
    """

    def __init__(
        self, title: str, degree: Degree = Degree.OPTIONAL, impact: Impact = Impact.WRITE
    ) -> None:
        self.title, self.degree, self.impact = title, degree, impact
        self.checks: list[Check] = []

    def check(
        self, clause: str, text: str, impact: Impact | None = None, degree: Degree | None = None
    ) -> Callable[[Judge], Judge]:
        """Return a decorator that adds a function as a check."""

        def add(judge: Judge) -> Judge:
            what = self.impact if impact is None else impact
            self.checks.append(Check(clause, text, what, judge, degree or self.degree))
            return judge

        return add


BEATS = 20
"""Periods of which the median is taken."""

TOLERANCE = 0.1
"""Share by which the median period may be off: an adapter and a host have their own delays."""


def median_period(times: Sequence[float]) -> float:
    """Return the median time between instants [s] in ms."""
    return median(b - a for a, b in pairwise(times)) * 1000


def judge_period(times: Sequence[float], right: float) -> str:
    """Return the median period of some instants [s] in words.

    Args:
        times: the instants.
        right: the right period [ms].

    Raises:
        Deviation: it is another one.
    """
    found = median_period(times)
    if abs(found - right) > TOLERANCE * right:
        raise Deviation(f"period {found:.1f} ms; {right:g} ms is right")
    return f"{found:.1f} ms"
