"""The findings of a commissioning step: measures with limits, named faults, a verdict."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder.quantities import QUANTITIES
from hil_bench.shown_units import display_unit
from hil_bench.units import MILLISECOND, SECOND, Unit

SAMPLE_CHANNELS = tuple(Channel(q.name, q.unit) for q in QUANTITIES if q.is_recorded)
"""What the drivers tell at each sample, after the time."""


class Verdict(StrEnum):
    """The verdict on a step."""

    PASSED = "passed"
    FAILED = "failed"
    """A measure is out of its limits."""
    STOPPED = "stopped"
    """It left a limit, or a device failed: the valve was closed and the step ended."""
    NOT_RUN = "not run"


@dataclass(frozen=True, slots=True)
class Measure:
    """One number with what it should be.

    Attributes:
        name: what it is.
        value: in its SI unit; NaN where it could not be told.
        unit: the symbol of its SI unit; empty for a plain number.
        low: the smallest that is right.
        high: the largest that is right.
    """

    name: str
    value: float
    unit: str
    low: float = -math.inf
    high: float = math.inf

    @property
    def is_judged(self) -> bool:
        """Return True if it has limits."""
        return self.low > -math.inf or self.high < math.inf

    @property
    def is_right(self) -> bool:
        """Return True within its limits or without any; with limits, unknown is not right."""
        return not self.is_judged or self.low <= self.value <= self.high

    def text(self) -> str:
        """Return the value for people."""
        unit = shown_unit(self.unit)
        return f"{unit.from_si(self.value):.4g} {unit.symbol}".rstrip()

    def range_text(self) -> str:
        """Return the limits for people; empty without any."""
        if not self.is_judged:
            return ""
        unit = shown_unit(self.unit)
        low, high = unit.from_si(self.low), unit.from_si(self.high)
        if self.low == -math.inf:
            return f"up to {high:.4g} {unit.symbol}".rstrip()
        if self.high == math.inf:
            return f"from {low:.4g} {unit.symbol}".rstrip()
        return f"{low:.4g} to {high:.4g} {unit.symbol}".rstrip()


def shown_unit(symbol: str) -> Unit:
    """Return the unit in which a quantity of this SI unit is shown."""
    return MILLISECOND if symbol == SECOND.symbol else display_unit(symbol)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A fault that the step can name.

    Attributes:
        name: in two or three words.
        evidence: what shows it.
        mend: what to look at.
    """

    name: str
    evidence: str
    mend: str


@dataclass(frozen=True, slots=True)
class Curve:
    """A characteristic for the report.

    Attributes:
        title: what it shows.
        x_label: with the unit.
        y_label: with the unit.
        x: as it was measured, in the unit of the label.
        y: likewise.
        fit_x: of the line or model through it; empty for none.
        fit_y: likewise.
        is_frequency: whether x is a frequency, to be drawn on a logarithmic axis.
    """

    title: str
    x_label: str
    y_label: str
    x: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]
    fit_x: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    fit_y: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    is_frequency: bool = False


@dataclass(slots=True)
class StepResult:
    """The findings of one step.

    Attributes:
        kind: the step.
        verdict: how it ended.
        measures: its numbers.
        findings: the faults that it names.
        notes: what else is worth knowing, a sentence each.
        problem: why it was stopped or not run, empty otherwise.
        trace: its samples; None without motion or recording.
        curves: its characteristics.
        duration: how long it took [s].
        is_interrupted: whether Ctrl-C ended it.
        is_bus_lost: whether the loss of the bus did.
    """

    kind: str
    verdict: Verdict = Verdict.PASSED
    measures: list[Measure] = field(default_factory=list)
    findings: list[Diagnosis] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    problem: str = ""
    trace: Recording | None = None
    curves: list[Curve] = field(default_factory=list)
    duration: float = 0.0
    is_interrupted: bool = False
    is_bus_lost: bool = False

    def judge(self) -> None:
        """Set the verdict by measures and findings, unless the step was stopped or not run."""
        is_right = all(measure.is_right for measure in self.measures) and not self.findings
        if self.verdict in {Verdict.PASSED, Verdict.FAILED}:
            self.verdict = Verdict.PASSED if is_right else Verdict.FAILED
