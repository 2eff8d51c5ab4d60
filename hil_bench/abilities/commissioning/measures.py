"""Measures of a rig with their uncertainty, estimated from samples."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder.quantities import QUANTITIES
from hil_bench.units import MILLISECOND, SECOND, Unit

# The findings of a commissioning step: measures with limits, named faults, a verdict.

SAMPLE_CHANNELS = tuple(Channel(q.name, q.unit) for q in QUANTITIES if q.is_recorded)
"""What the drivers tell at each sample, after the time."""


class Verdict(StrEnum):
    """The verdict on a step."""

    PASSED = "passed"
    FAILED = "failed"
    """A measure is out of its limits."""
    STOPPED = "stopped"
    """It left a limit, or a device failed: the valve was closed and the step ended."""
    INCONCLUSIVE = "inconclusive"
    """A measure could not be told, and no other one is out of its limits."""
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

    @property
    def is_wrong(self) -> bool:
        """Return True if it is known, and out of its limits."""
        return not self.is_right and not math.isnan(self.value)

    def text(self) -> str:
        """Return the value for people; more digits where four would put it within its limits."""
        unit = shown_unit(self.unit)
        shown = [unit.from_si(each) for each in (self.value, self.low, self.high)]
        rounded = [f"{each:.4g}" for each in shown]
        if not self.is_right and rounded[0] in rounded[1:]:
            rounded[0] = f"{shown[0]:.9g}"
        return f"{rounded[0]} {unit.symbol}".rstrip()

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
        if self.verdict is not Verdict.PASSED:
            return
        if self.findings or any(measure.is_wrong for measure in self.measures):
            self.verdict = Verdict.FAILED
        elif not all(measure.is_right for measure in self.measures):
            self.verdict = Verdict.INCONCLUSIVE


# Estimates from samples: slopes, dead band, friction, frequency response, second-order mode.

Samples = npt.NDArray[np.float64]


def slope(time: Samples, values: Samples) -> float:
    """Return the slope of the straight line of least squares, [1/s] of the values' unit."""
    if len(time) < 2:
        return math.nan
    centred = time - time.mean()
    return float(centred @ (values - values.mean()) / (centred @ centred))


def noise(time: Samples, values: Samples) -> float:
    """Return the root mean square of the values about that line."""
    if len(time) < 3:
        return math.nan
    line = values.mean() + slope(time, values) * (time - time.mean())
    return float(np.sqrt(np.mean((values - line) ** 2)))


class DeadBand(NamedTuple):
    """The spool positions at which a valve begins to open.

    Attributes:
        positive: spool position from which the piston extends [-].
        negative: spool position from which it retracts [-].
        gain_positive: speed per spool position beyond it [m/s].
        gain_negative: likewise.
    """

    positive: float
    negative: float
    gain_positive: float
    gain_negative: float

    @property
    def zero(self) -> float:
        """The middle [-]."""
        return 0.5 * (self.positive + self.negative)

    @property
    def width(self) -> float:
        """From one edge to the other [-]."""
        return self.positive - self.negative


def dead_band(spool: Samples, speed: Samples) -> DeadBand:
    """Return the edges of the dead band and the gains beyond it.

    The edge of a side is where the line of spool against speed meets speed 0, over the speeds from
    a tenth to six tenths of the greatest, which the bend at greater openings does not reach. The
    gain is the slope of speed against spool over a fifth to nine tenths.
    """
    sides = [_edge_and_gain(sign * spool, sign * speed) for sign in (1.0, -1.0)]
    (positive, gain_positive), (negative, gain_negative) = sides
    return DeadBand(positive, -negative, gain_positive, gain_negative)


def _edge_and_gain(spool: Samples, speed: Samples) -> tuple[float, float]:
    fastest = speed[spool > 0].max(initial=0.0)
    near = (spool > 0) & (speed > 0.1 * fastest) & (speed < 0.6 * fastest)
    wide = (spool > 0) & (speed > 0.2 * fastest) & (speed < 0.9 * fastest)
    if min(near.sum(), wide.sum()) < 5:
        return math.nan, math.nan
    edge = spool[near].mean() - slope(speed[near], spool[near]) * speed[near].mean()
    return float(edge), slope(spool[wide], speed[wide])


class Friction(NamedTuple):
    """Friction as far as slow motion shows it.

    Attributes:
        coulomb: part that does not depend on the speed [N].
        viscous: part per speed [N s/m].
        load: the same force in both directions [N].
    """

    coulomb: float
    viscous: float
    load: float


def friction(speed: Samples, force: Samples, *, slowest: float) -> Friction:
    """Return F = F_load + sgn(v) F_c + σ v by least squares over the speeds above `slowest` [m/s].

    Below it, in the Stribeck range, friction falls with speed and is no straight line.
    """
    chosen = np.abs(speed) > slowest
    v = speed[chosen]
    if not (np.any(v > 0) and np.any(v < 0)):
        return Friction(math.nan, math.nan, math.nan)
    columns = np.column_stack((np.sign(v), v, np.ones_like(v)))
    coulomb, viscous, load = np.linalg.lstsq(columns, force[chosen], rcond=None)[0].tolist()
    return Friction(coulomb, viscous, load)


class FrequencyResponse(NamedTuple):
    """A response at some frequencies.

    Attributes:
        frequency: [Hz].
        response: complex, output unit per input unit.
        coherence: from 0 to 1: how much of the output the input explains.
    """

    frequency: Samples
    response: npt.NDArray[np.complex128]
    coherence: Samples


def frequency_response(
    excitation: Samples, answer: Samples, period: float, band: tuple[float, float]
) -> FrequencyResponse:
    """Return the response between two signals in a band [Hz], averaged over neighbouring lines.

    Args:
        excitation: a signal that sweeps through the band.
        answer: sampled with it.
        period: between two samples [s].
        band: lowest and highest frequency [Hz].
    """
    count = len(excitation)
    ramp = np.linspace(-1.0, 1.0, count)
    window = np.minimum(1.0, 20.0 * (1.0 - np.abs(ramp)))  # a sweep has no period to keep
    spectra = []
    for signal in (excitation, answer):
        line = np.polynomial.Polynomial.fit(ramp, signal, 1)(ramp)
        spectra.append(np.fft.rfft(window * (signal - line)))
    x, y = spectra
    frequencies = np.fft.rfftfreq(count, period)
    width = max(1, round(1.5 / (frequencies[1] or 1.0)))  # 1.5 Hz to each side
    kernel = np.ones(2 * width + 1)

    def smooth(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.convolve(values, kernel, "same")

    xx, yy = smooth(np.abs(x) ** 2 + 0j).real, smooth(np.abs(y) ** 2 + 0j).real
    xy = smooth(y * np.conj(x))
    chosen = (frequencies >= band[0]) & (frequencies <= band[1])
    return FrequencyResponse(
        np.asarray(frequencies[chosen], dtype=np.float64),
        (xy / np.maximum(xx, 1e-300))[chosen],
        (np.abs(xy) ** 2 / np.maximum(xx * yy, 1e-300))[chosen],
    )


def derivative(values: Samples, time: Samples) -> Samples:
    """Return the slope at each sample by the samples beside it; at the ends by one of them."""
    return np.asarray(np.gradient(values, time))


def resample(time: Samples, values: Samples, period: float) -> Samples:
    """Return values at equal distances from the first time on, straight lines between samples."""
    count = round((time[-1] - time[0]) / period) + 1
    return np.asarray(np.interp(time[0] + period * np.arange(count), time, values))


def undo_derivative(measured: FrequencyResponse, period: float) -> FrequencyResponse:
    """Return a response to `derivative` as a true derivative would have it.

    A difference over two periods lets sin(ωT) / (ωT) of it through.
    """
    share = np.sinc(2.0 * measured.frequency * period)
    return measured._replace(response=measured.response / share)


class Mode(NamedTuple):
    """A second-order mode K ω₀² (1 + jω T) / (ω₀² - ω² + 2 ζ ω₀ jω).

    Attributes:
        frequency: ω₀ / 2π [Hz].
        damping: ζ [-].
        gain: K, output unit per input unit.
        lead: T, negative for a delay, as sensors have one [s].
    """

    frequency: float
    damping: float
    gain: float
    lead: float = 0.0

    def response(self, frequency: Samples) -> npt.NDArray[np.complex128]:
        """Return its response at some frequencies [Hz]."""
        ratio = frequency / self.frequency
        lead = 1.0 + 2j * np.pi * frequency * self.lead
        return np.asarray(self.gain * lead / (1.0 - ratio**2 + 2j * self.damping * ratio))


_ROUNDS = 20


def fit_mode(measured: FrequencyResponse) -> Mode:
    """Return the mode of least squares, weighted with the coherence.

    H (ω₀² - ω² + 2 ζ ω₀ jω) = K ω₀² (1 + jω T) is linear in ω₀², 2 ζ ω₀, K ω₀² and K ω₀² T; each
    round divides it by the last round's denominator, so that not the equation's error is least but
    the response's (Sanathanan and Koerner 1963).
    """
    omega = 2.0 * np.pi * measured.frequency
    h = measured.response
    weight = np.sqrt(np.clip(measured.coherence, 0.0, 1.0))
    denominator = np.ones_like(h)
    square = twice = constant = slanted = math.nan
    for _ in range(_ROUNDS):
        scale = weight / np.abs(denominator)
        terms = (h * scale, 1j * omega * h * scale, -scale, -1j * omega * scale)
        columns = np.column_stack(terms)
        right = h * omega**2 * scale
        square, twice, constant, slanted = np.linalg.lstsq(
            np.vstack((columns.real, columns.imag)),
            np.concatenate((right.real, right.imag)),
            rcond=None,
        )[0].tolist()
        denominator = (square - omega**2 + 1j * omega * twice) / omega[-1] ** 2
    if not square > 0.0:
        return Mode(math.nan, math.nan, math.nan)
    root = math.sqrt(square)
    return Mode(root / (2.0 * math.pi), twice / (2.0 * root), constant / square, slanted / constant)


def rise_time(time: Samples, setpoint: Samples, actual: Samples) -> float:
    """Return the time from a set-point's first change to 63 % of the actual value's change [s].

    Between two samples it is taken to move in a straight line; NaN where it never gets there.
    """
    changes = np.flatnonzero(np.diff(setpoint))
    if not changes.size:
        return math.nan
    start = int(changes[0])
    origin, target = actual[start], setpoint[start + 1]
    share = (actual[start:] - origin) / (target - origin)
    there = np.flatnonzero(share >= 1.0 - math.exp(-1.0))
    if not there.size or not there[0]:
        return math.nan
    after = start + int(there[0])
    before, level = share[there[0] - 1], 1.0 - math.exp(-1.0)
    part = (level - before) / (share[there[0]] - before)
    reached = time[after - 1] + part * (time[after] - time[after - 1])
    return float(reached - time[start])
