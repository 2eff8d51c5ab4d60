"""A statement of the paper beside what was found."""

from enum import StrEnum
from typing import NamedTuple


class Verdict(StrEnum):
    """The verdict on a statement of the paper."""

    HOLDS = "holds"
    CORRECTED = "holds with a correction"
    FAILS = "does not hold as printed"


class Statement(NamedTuple):
    """One statement of the paper.

    Attributes:
        place: where it stands, as in ``IV-A, (19)``.
        claim: what it says, in the paper's words where they are in quotation marks.
        found: the numbers found.
        verdict: what they make of it.
    """

    place: str
    claim: str
    found: str
    verdict: Verdict
