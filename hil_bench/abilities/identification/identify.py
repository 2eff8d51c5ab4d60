"""From a record to a plant: the fit, what it tells, and a trial on the part it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.approach import SIDE_MINIMUM, Rival, approach, find_rivals
from hil_bench.abilities.identification.fit import Fit, Fitter, Report
from hil_bench.abilities.identification.intervals import REACH, Interval, find_intervals
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.spool import fit_spool, recorded_spool
from hil_bench.abilities.identification.stages import FINE
from hil_bench.abilities.identification.trial import Trial, trial_pieces, try_out
from hil_bench.abilities.identification.unknowns import (
    KINDS,
    PROMPT,
    SENSING,
    SESSION_FLOW,
    Sensors,
    Unknowns,
    check_names,
)
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.extended_batch import states_without_start
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP

Values = npt.NDArray[np.float64]

_REPEATS = 4  # of the fit, while it changes which pieces the model explains


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimate of one parameter.

    Attributes:
        name: its symbol, as in `PlantParameters`.
        value: found, or kept as configured where the record does not tell it [SI].
        deviation: standard deviation of what was found [SI].
        interval: about what was found, which holds the parameter with 95 % probability [SI].
        is_told: whether the record tells it.
    """

    name: str
    value: float
    deviation: float
    interval: Interval
    is_told: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """The result of an identification.

    Attributes:
        record: the measurement.
        known: what was configured.
        sensors: how far they are behind, as configured.
        parameters: what was found, and as configured what was not.
        offsets: errors of the pressure sensors in each recording, shape (recordings, 2) [Pa].
        offset_deviations: their standard deviations, of the same shape [Pa].
        flows: what the valve passes in each recording, as factors of the first; None where that was
            not sought.
        decrement: how far the optimum is, in standard deviations.
        flow_deviations: their standard deviations, 0 for the first.
        estimates: one a sought parameter.
        correlations: of the errors of the estimates, shape (estimates, estimates).
        residual: rms of the fit's residuals of each signal, as a multiple of its noise, shape (3,);
            not a number where no recording has the signal.
        is_reached: whether the fit has ended at an optimum.
        is_white: whether its residuals are white, so that they count as independent.
        rivals: other starts that have ended elsewhere.
        pieces: how many pieces of the record were fitted.
        left_out: how many were not, because the model does not explain them.
        trial: on the rest of the record.
    """

    record: AxisRecord
    known: PlantParameters
    sensors: Sensors
    parameters: PlantParameters
    offsets: Values
    offset_deviations: Values
    estimates: tuple[Estimate, ...]
    correlations: Values
    residual: Values
    is_reached: bool
    is_white: bool
    rivals: tuple[Rival, ...]
    pieces: int
    left_out: int
    trial: Trial
    flows: Values | None = None
    flow_deviations: Values | None = None
    decrement: float = np.inf

    @property
    def told(self) -> list[Estimate]:
        """The estimates of the identifiable parameters."""
        return [estimate for estimate in self.estimates if estimate.is_told]

    @property
    def not_told(self) -> list[Estimate]:
        """The estimates of the parameters that are not identifiable from this record."""
        return [estimate for estimate in self.estimates if not estimate.is_told]


def identify(  # noqa: PLR0913 - what is known, and how the search is done
    record: AxisRecord,
    known: PlantParameters,
    options: PlantOptions,
    *,
    step: float = DEFAULT_STEP,
    names: Sequence[str] = tuple(KINDS),
    sensors: Sensors = PROMPT,
    starts: int = 24,
    seed: int = 1,
    report: Report = lambda _: None,
) -> Identification:
    """Return the plant that a record tells.

    What the record does not tell is fitted too, so that it does not mislead the rest, but keeps the
    configured value in the result.

    Args:
        record: of the machine.
        known: the configured parameters: areas, volumes, stroke, pressures of supply and tank, and
            starts for all that is sought.
        options: of the plant, as configured.
        step: of the plant's solver [s].
        names: the sought parameters, of `KINDS` and `EXTRAS`; the others stay as configured.
        sensors: how far they are behind, as configured.
        starts: how many random candidates the search tries.
        seed: of the random generator.
        report: takes a few words after each piece of work.
    """
    check_options(options)
    check_names(names, len(record.sessions))
    has_flows = SESSION_FLOW in names
    names = tuple(name for name in names if name != SESSION_FLOW)
    pieces = trial_pieces(record, known.h)
    spool = fit_spool(record, known)
    with_spool = replace(known, **{name: value for name, (value, _) in spool.items()})
    sought = tuple(name for name in names if name not in spool)
    unknowns = Unknowns(with_spool, sought, len(record.sessions), sensors, has_flows)
    is_behind = sensors != PROMPT or not set(SENSING).isdisjoint(names)
    fitter = Fitter(record, options, step, report, is_behind)
    found = _fit(fitter, unknowns, starts, seed)
    guess = found.unknowns.guess(found.fit.variables)
    estimates = _estimates(found, names, spool)
    plant = set(PlantParameters.__slots__)
    last = len(sought) + 2 * len(record.sessions)
    deviations = _deviations(found.unknowns, found.fit)
    told = {one.name: one.value for one in estimates if one.is_told and one.name in plant}
    if any(one.name == "gain" and one.is_told for one in estimates):
        told |= {name: getattr(guess.parameters, name) for name in ("w", "alpha", "beta")}
    return Identification(
        record=found.fitter.record,
        known=known,
        sensors=sensors,
        parameters=replace(known, **told),
        offsets=guess.offsets,
        offset_deviations=deviations[len(sought) : last].reshape(-1, 2),
        flows=np.array(guess.flows) if has_flows else None,
        flow_deviations=np.array([0.0, *deviations[last:]]) if has_flows else None,
        estimates=tuple(estimates),
        correlations=_correlations(found.unknowns, found.fit, names),
        residual=found.fit.residual,
        is_reached=found.fit.optimum.is_reached,
        decrement=found.fit.optimum.decrement,
        is_white=found.fit.is_white,
        rivals=found.rivals,
        pieces=len(found.fit.optimum.residuals),
        left_out=found.left_out,
        trial=try_out(found.fitter, guess, pieces),
    )


@dataclass(frozen=True, slots=True)
class _Found:
    """The ends of the fits."""

    unknowns: Unknowns
    fit: Fit
    fitter: Fitter
    left_out: int
    rivals: tuple[Rival, ...]


def _fit(fitter: Fitter, unknowns: Unknowns, starts: int, seed: int) -> _Found:
    """Fit until the pieces that the model explains stay the same."""
    every = fitter.pieces(FINE, unknowns.known.h)
    first = approach(fitter, unknowns, every, starts, seed)
    fit = first[0]
    record = fitter.record
    # Oil that rings looks like noise; the fit knows better, unless it misses something.
    scale = np.where(fit.residual <= SIDE_MINIMUM, fit.residual, 1.0)
    fitter = fitter.with_record(record.with_noise(scale * record.noise))
    fitter.begin_at(fit)  # not where another start may have left the pieces
    pieces = fitter.explained(unknowns, fit.variables, every)
    for _ in range(_REPEATS):
        fit = fitter.polish(unknowns, fit.variables, pieces)
        fitted, pieces = pieces, fitter.explained(unknowns, fit.variables, every)
        if np.array_equal(pieces.rows, fitted.rows):
            break
    left_out = len(every.rows) - len(fit.optimum.residuals)
    return _Found(unknowns, fit, fitter, left_out, tuple(find_rivals(unknowns, fit, first[1:])))


def find_vague(record: AxisRecord, unknowns: Unknowns, fit: Fit) -> list[str]:
    """Return the parameters that a record does not tell.

    They have been fitted with the others, so that the deviations of the others hold whatever the
    values of these.
    """
    limits = [kind.told_within for kind in unknowns.kinds]
    is_vague = np.sqrt(np.diag(fit.covariance)) > limits
    parameters = unknowns.guess(fit.variables).parameters
    return [
        name
        for name, vague in zip(unknowns.names, is_vague, strict=False)
        if vague or (name == "alpha" and not _opens_fully(record, parameters))
    ]


def _opens_fully(record: AxisRecord, parameters: PlantParameters) -> bool:
    """Return True if the spool passes the full opening where the record is fitted."""
    spool = recorded_spool(parameters, record)[:, 0]
    reach = max(float(np.abs(spool[rows.start : rows.stop]).max()) for rows in record.fitted)
    return reach > parameters.alpha + parameters.beta


def _covariance(unknowns: Unknowns, fit: Fit) -> Values:
    """Return the covariance of all parameters and offsets in SI units."""
    slopes = unknowns.slopes_si(fit.variables)
    return np.asarray(slopes @ fit.covariance @ slopes.T)


def _deviations(unknowns: Unknowns, fit: Fit) -> Values:
    """Return the standard deviation of each parameter and offset in SI units."""
    return np.asarray(np.sqrt(np.diag(_covariance(unknowns, fit))))


def _correlations(unknowns: Unknowns, fit: Fit, names: Sequence[str]) -> Values:
    """Return the correlations of the sought parameters; those of the spool alone have none."""
    covariance = _covariance(unknowns, fit)
    deviations = np.sqrt(np.diag(covariance))
    known = covariance / np.outer(deviations, deviations)
    correlations = np.eye(len(names))
    places = [names.index(name) for name in unknowns.names]
    correlations[np.ix_(places, places)] = known[: len(places), : len(places)]
    return correlations


def _estimates(
    found: _Found, names: Sequence[str], spool: dict[str, tuple[float, float]]
) -> list[Estimate]:
    unknowns, fit = found.unknowns, found.fit
    guess = unknowns.guess(fit.variables)
    start = unknowns.guess(unknowns.start)
    deviations = dict(zip(unknowns.names, _deviations(unknowns, fit).tolist(), strict=False))
    intervals = find_intervals(unknowns, fit, deviations, lambda: found.fitter.report("interval"))
    deviations |= {name: deviation for name, (_, deviation) in spool.items()}
    vague = find_vague(found.fitter.record, unknowns, fit)
    estimates = []
    for name in names:
        value, deviation = guess.value(name), deviations[name]
        about = (value - REACH * deviation, value + REACH * deviation)
        if name in vague:
            value = start.value(name)
        interval = intervals.get(name, about)
        estimates.append(Estimate(name, value, deviation, interval, name not in vague))
    return estimates


def check_options(options: PlantOptions) -> None:
    """Refuse what a start of six states does not determine.

    Raises:
        ConfigError: such an extension is on.
    """
    hidden = states_without_start(options)
    if hidden:
        what = " and ".join([", ".join(hidden[:-1]), hidden[-1]] if len(hidden) > 1 else hidden)
        raise ConfigError(
            f"identification cannot carry {what} of this axis, whose states at the start of a "
            "piece no recording shows; switch that off"
        )
