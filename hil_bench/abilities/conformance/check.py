"""A check of the suite, and its possible ends.

Clauses are those of CiA 301 version 4.2.0. CiA 305 is cited by the name of the service.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum

from hil_bench.abilities.conformance.device import DeviceUnderTest


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
        checks: its checks.
    """

    def __init__(self, title: str, degree: Degree = Degree.OPTIONAL) -> None:
        self.title = title
        self.degree = degree
        self.checks: list[Check] = []

    def check(
        self, clause: str, text: str, impact: Impact = Impact.READ, degree: Degree | None = None
    ) -> Callable[[Judge], Judge]:
        """Return a decorator that adds a function as a check."""

        def add(judge: Judge) -> Judge:
            self.checks.append(Check(clause, text, impact, judge, degree or self.degree))
            return judge

        return add
