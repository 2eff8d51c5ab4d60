"""From a record to a plant: the fit, what it tells, and a trial on the part it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.identification.fit import Fit, Fitter, Report
from hil_bench.identification.record import AxisRecord
from hil_bench.identification.shooting import Pieces, Shooting, cut_pieces
from hil_bench.identification.spool import fit_spool
from hil_bench.identification.stages import AGAIN, CLOSE, FINE, LENGTH, MIDDLE, Stage
from hil_bench.identification.unknowns import KINDS, OFFSETS, Guess, Unknowns
from hil_bench.plant import PlantOptions, PlantParameters

Values = npt.NDArray[np.float64]

_SIDE_MINIMUM = 1.3  # times the noise: residuals above may mean one
_REPEATS = 3  # of the fit, while it changes which pieces the model explains


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the record says of one parameter.

    Attributes:
        name: its symbol, as in `PlantParameters`.
        value: found, or kept as configured where the record does not tell it [SI].
        deviation: standard deviation of the value [SI]; where it is not told, of what was found.
        is_told: whether the record tells it.
    """

    name: str
    value: float
    deviation: float
    is_told: bool


class Run(NamedTuple):
    """One run of the plant that was found over a part of the record.

    Attributes:
        rows: of the record, shape (rows,).
        model: position [m], P_A and P_B [Pa], shape (rows, 3).
    """

    rows: npt.NDArray[np.int64]
    model: Values


@dataclass(frozen=True, slots=True)
class Trial:
    """The plant that was found, beside the part of the record that was not used for the fit.

    Attributes:
        rows: of each piece of the record, shape (pieces, rows of a piece).
        model: position [m], P_A and P_B [Pa], started anew in each piece, shape (*rows.shape, 3).
        residual: rms of model less record of each signal, as a multiple of its noise, shape (3,).
        runs: over each part of the record that was not used, started once.
    """

    rows: npt.NDArray[np.int64]
    model: Values
    residual: Values
    runs: tuple[Run, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """What a record told.

    Attributes:
        record: the measurement.
        known: what was configured.
        parameters: what was found, and as configured what was not.
        offsets: errors of the pressure sensors, shape (2,) [Pa].
        offset_deviations: their standard deviations, shape (2,) [Pa].
        estimates: one a sought parameter.
        residual: rms of the fit's residuals, as a multiple of the noise.
        pieces: how many pieces of the record were fitted.
        left_out: how many were not, because the model does not explain them.
        trial: on the rest of the record.
    """

    record: AxisRecord
    known: PlantParameters
    parameters: PlantParameters
    offsets: Values
    offset_deviations: Values
    estimates: tuple[Estimate, ...]
    residual: float
    pieces: int
    left_out: int
    trial: Trial

    @property
    def told(self) -> list[Estimate]:
        """What the record tells."""
        return [estimate for estimate in self.estimates if estimate.is_told]

    @property
    def not_told(self) -> list[Estimate]:
        """What it does not tell."""
        return [estimate for estimate in self.estimates if not estimate.is_told]


def identify(  # noqa: PLR0913 - what is known, and how the search is done
    record: AxisRecord,
    known: PlantParameters,
    options: PlantOptions,
    *,
    step: float = 5e-5,
    names: Sequence[str] = tuple(KINDS),
    starts: int = 24,
    seed: int = 1,
    report: Report = lambda _: None,
) -> Identification:
    """Return the plant that a record tells.

    What the record does not tell keeps the configured value, and the rest is fitted again with it.

    Args:
        record: of the machine.
        known: the configured parameters: areas, volumes, stroke, pressures of supply and tank, and
            starts for all that is sought.
        options: of the plant, as configured.
        step: of the plant's solver [s].
        names: the sought parameters, of `KINDS`.
        starts: how many random candidates the search tries.
        seed: of the random generator.
        report: takes a few words after each piece of work.
    """
    _check_options(options)
    trial_pieces = _trial_pieces(record, known.h)
    spool = fit_spool(record, known)
    with_spool = replace(known, **{name: value for name, (value, _) in spool.items()})
    unknowns = Unknowns(with_spool, tuple(name for name in names if name not in spool))
    fitter = Fitter(record, options, step, report)
    found = _fit(fitter, unknowns, starts, seed)
    guess = found.unknowns.guess(found.fit.variables)
    return Identification(
        record=record,
        known=known,
        parameters=guess.parameters,
        offsets=guess.offsets,
        offset_deviations=_deviations(found.unknowns, found.fit)[-len(OFFSETS) :],
        estimates=tuple(_estimates(found, names, spool)),
        residual=found.fit.residual,
        pieces=len(found.pieces.rows),
        left_out=found.left_out,
        trial=_try(fitter, guess, trial_pieces),
    )


@dataclass(frozen=True, slots=True)
class _Found:
    """Where the fits ended, with what the earlier ones said of what they could not tell."""

    unknowns: Unknowns
    fit: Fit
    pieces: Pieces
    left_out: int
    vague: dict[str, float]


def _fit(fitter: Fitter, unknowns: Unknowns, starts: int, seed: int) -> _Found:
    """Fit, leave out what the record does not tell, and fit again, until all is told."""
    stop = unknowns.known.h
    every = fitter.pieces(FINE, stop)
    variables = _approach(fitter, unknowns, fitter.search(unknowns, starts, seed)).variables
    vague: dict[str, float] = {}
    pieces = fitter.explained(unknowns, variables, every)
    repeats = 0
    while True:
        fit = fitter.fit(unknowns, variables, FINE, pieces)
        dropped, fitted = find_vague(unknowns, fit), pieces
        pieces = fitter.explained(unknowns, fit.variables, every)
        repeats += 1
        is_settled = np.array_equal(pieces.rows, fitted.rows) or repeats > _REPEATS
        if is_settled and not dropped:
            left_out = len(every.rows) - len(fitted.rows)
            return _Found(unknowns, fit, fitted, left_out, vague)
        deviations = dict(zip(unknowns.names, _deviations(unknowns, fit).tolist(), strict=False))
        vague |= {name: deviations[name] for name in dropped}
        guess = unknowns.guess(fit.variables)
        unknowns = unknowns.without(dropped)
        variables = unknowns.variables_of(guess)


def _approach(fitter: Fitter, unknowns: Unknowns, ways: Sequence[Values]) -> Fit:
    """Return the best fit from what the search has found.

    Another way is tried as long as the one before looks like a side minimum.
    """
    fits: list[Fit] = []
    for variables in ways:
        fits.append(_follow(fitter, unknowns, variables, (MIDDLE, CLOSE)))
        if fits[-1].residual <= _SIDE_MINIMUM:
            return fits[-1]
    best = min(fits, key=lambda fit: fit.cost)
    fits.append(_follow(fitter, unknowns, best.variables, AGAIN))
    return min(fits, key=lambda fit: fit.cost)


def _follow(fitter: Fitter, unknowns: Unknowns, variables: Values, stages: Sequence[Stage]) -> Fit:
    """Return the first fine fit, to which some stages lead."""
    for stage in stages:
        pieces = fitter.pieces(stage, unknowns.known.h)
        variables = fitter.fit(unknowns, variables, stage, pieces).variables
    every = fitter.pieces(FINE, unknowns.known.h)
    return fitter.fit(unknowns, variables, FINE._replace(enough=1e-3), every)


def find_vague(unknowns: Unknowns, fit: Fit) -> list[str]:
    """Return the parameters that a fit leaves open, the vaguest first.

    One that is left open may take others with it that are told as soon as it is known, so they are
    taken out one by one.
    """
    information = np.linalg.pinv(fit.covariance, hermitian=True)
    limits = np.array([kind.told_within for kind in unknowns.kinds])
    kept = list(range(len(limits)))
    vague = []
    while kept:
        covariance = np.linalg.pinv(information[np.ix_(kept, kept)], hermitian=True)
        excess = np.sqrt(np.diag(covariance)) / limits[kept]
        worst = int(np.argmax(excess))
        if excess[worst] <= 1.0:
            break
        vague.append(unknowns.names[kept.pop(worst)])
    return vague


def _deviations(unknowns: Unknowns, fit: Fit) -> Values:
    """Return the standard deviation of each parameter and offset in SI units."""
    step = 1e-6
    slopes = np.array(
        [
            (_si(unknowns, fit.variables + shift) - _si(unknowns, fit.variables)) / step
            for shift in step * np.eye(len(fit.variables))
        ]
    ).T
    return np.asarray(np.sqrt(np.diag(slopes @ fit.covariance @ slopes.T)))


def _si(unknowns: Unknowns, variables: Values) -> Values:
    guess = unknowns.guess(variables)
    return np.array([*(getattr(guess.parameters, name) for name in unknowns.names), *guess.offsets])


def _estimates(
    found: _Found, names: Sequence[str], spool: dict[str, tuple[float, float]]
) -> list[Estimate]:
    unknowns, fit = found.unknowns, found.fit
    parameters = unknowns.guess(fit.variables).parameters
    deviations = dict(zip(unknowns.names, _deviations(unknowns, fit).tolist(), strict=False))
    deviations |= {name: deviation for name, (_, deviation) in spool.items()} | found.vague
    return [
        Estimate(name, getattr(parameters, name), deviations[name], name not in found.vague)
        for name in names
    ]


def _try(fitter: Fitter, guess: Guess, pieces: Pieces) -> Trial:
    shooting = fitter.shooting(FINE, pieces)
    shooting.settle(guess)
    deviations = shooting.deviations(guess, shooting.states)
    rows = _rows(pieces)
    return Trial(
        rows=rows,
        model=fitter.record.measured[rows] + deviations,
        residual=np.sqrt(np.square(deviations).mean(axis=(0, 1))) / fitter.record.noise,
        runs=tuple(_run(fitter, guess, shooting, part) for part in _parts(fitter.record, pieces)),
    )


def _run(fitter: Fitter, guess: Guess, settled: Shooting, part: range) -> Run:
    """Return one run over a part, from the settled start of its first piece."""
    first = int(np.searchsorted(settled.pieces.rows, part.start))
    start = settled.pieces.rows[first : first + 1]
    pieces = Pieces(start, part.stop - 1 - int(start[0]))
    shooting = fitter.shooting(FINE, pieces)
    deviations = shooting.deviations(guess, settled.states[first : first + 1])
    (rows,) = _rows(pieces)
    return Run(rows, fitter.record.measured[rows] + deviations[0])


def _parts(record: AxisRecord, pieces: Pieces) -> list[range]:
    """Return the parts for the trial that have pieces."""
    return [
        part
        for part in record.tried
        if ((pieces.rows >= part.start) & (pieces.rows < part.stop)).any()
    ]


def _rows(pieces: Pieces) -> npt.NDArray[np.int64]:
    return np.asarray(pieces.rows[:, np.newaxis] + 1 + np.arange(pieces.length))


def _trial_pieces(record: AxisRecord, stroke_end: float) -> Pieces:
    """Return the pieces of the part that the fit does not see.

    Raises:
        ConfigError: there are none clear of the end stops.
    """
    pieces = cut_pieces(record, record.tried, record.rows_in(LENGTH), stroke_end)
    if not len(pieces.rows):
        raise ConfigError(
            "the last fifth of the recording, on which the model is tried, has no piece of "
            f"{LENGTH:g} s clear of the end stops; give a longer one, and check stroke_mm"
        )
    return pieces


def _check_options(options: PlantOptions) -> None:
    """Refuse what the batches of plants cannot do.

    Raises:
        ConfigError: an extension is on.
    """
    if options.is_extended:
        raise ConfigError(
            "identification has the model of the paper only; switch off entrained air, LuGre "
            "friction, the supply unit, external leakage and loads of this axis"
        )
