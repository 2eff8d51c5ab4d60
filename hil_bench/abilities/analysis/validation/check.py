"""One quantity of the plant beside the value that it must have."""

from dataclasses import dataclass
from enum import StrEnum


class CheckVerdict(StrEnum):
    """The verdict of a check."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationCheck:
    """One quantity of the plant beside the value that it must have.

    Attributes:
        subject: the plant, as in ``Table I``.
        name: of the quantity, and where it is looked at.
        unit: its symbol; ``-`` for a pure number.
        source: where the expected value comes from.
        expected: the value that is right; None where there is none.
        found: what the plant has; None where it was not asked.
        tolerance: largest difference that passes, in the same unit.
        detail: why the check does not apply, or what else is worth knowing.
    """

    subject: str
    name: str
    unit: str
    source: str
    expected: float | None = None
    found: float | None = None
    tolerance: float = 0.0
    detail: str = ""

    @property
    def verdict(self) -> CheckVerdict:
        """The verdict: passed where the value found is within the tolerance; NaN never passes."""
        if self.expected is None or self.found is None:
            return CheckVerdict.NOT_APPLICABLE
        is_right = abs(self.found - self.expected) <= self.tolerance
        return CheckVerdict.PASSED if is_right else CheckVerdict.FAILED
