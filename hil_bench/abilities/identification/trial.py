"""The plant that was found, on the part of the record that the fit has not seen."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.fit import Fitter
from hil_bench.abilities.identification.pieces import Pieces, cut_pieces
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.shooting import Shooting
from hil_bench.abilities.identification.stages import FINE, LENGTH
from hil_bench.abilities.identification.unknowns import Guess
from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

_MOSTLY_CLEAR = 0.5  # of a piece that ends at a stop, or it tries nothing


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
        residual: rms of model less record of each signal, as a multiple of its noise, shape (3,);
            not a number where there is no such signal.
        runs: over each part of the record that was not used, started once.
    """

    rows: npt.NDArray[np.int64]
    model: Values
    residual: Values
    runs: tuple[Run, ...]


def trial_pieces(record: AxisRecord, stroke_end: float) -> Pieces:
    """Return the pieces of the part that the fit does not see.

    Raises:
        ConfigError: there are none clear of the end stops.
    """
    length = record.rows_in(LENGTH)
    pieces = cut_pieces(record, record.tried, length, stroke_end)
    if not len(pieces.rows):
        pieces = cut_pieces(record, record.tried, length, stroke_end, has_stops=True)
        pieces = pieces.chosen(_is_clear(record, pieces).mean(axis=1) >= _MOSTLY_CLEAR)
    if not len(pieces.rows):
        raise ConfigError(
            "the last fifth of the recording, on which the model is tried, has no piece of "
            f"{LENGTH:g} s clear of the end stops; give a longer one, and check stroke_mm"
        )
    return pieces


def try_out(fitter: Fitter, guess: Guess, pieces: Pieces) -> Trial:
    """Return the trial of a guess on these pieces."""
    shooting = fitter.shooting(FINE, pieces, guess.parameters)
    # What the contact of a stop does is the contact's, not that of the plant that was found.
    shooting.is_there &= _is_clear(fitter.record, pieces)[..., np.newaxis]
    shooting.settle(guess)
    deviations = shooting.deviations(guess, shooting.states)
    rows = _rows(pieces)
    return Trial(
        rows=rows,
        model=shooting.predict([guess], [shooting.states])[0],
        residual=_rms(np.where(shooting.is_there, deviations, np.nan)) / fitter.record.noise,
        runs=tuple(_run(fitter, guess, shooting, part) for part in _parts(fitter.record, pieces)),
    )


def _is_clear(record: AxisRecord, pieces: Pieces) -> npt.NDArray[np.bool_]:
    """Mark the rows of each piece before the piston touches a stop."""
    rows = _rows(pieces)
    if record.at_stop is None:
        return np.ones(rows.shape, dtype=np.bool_)
    return np.asarray(np.cumsum(record.at_stop[rows, 0], axis=1) == 0)


def _rms(deviations: Values) -> Values:
    """Return the rms of each signal over all pieces that have it, not a number where none has."""
    is_there = np.isfinite(deviations)
    squares = np.where(is_there, np.square(deviations), 0.0).sum(axis=(0, 1))
    count = is_there.sum(axis=(0, 1))
    return np.asarray(np.sqrt(squares / np.where(count > 0, count, np.nan)))


def _run(fitter: Fitter, guess: Guess, settled: Shooting, part: range) -> Run:
    """Return one run over a part, from the settled start of its first piece."""
    first = int(np.searchsorted(settled.pieces.rows, part.start))
    start = settled.pieces.rows[first : first + 1]
    pieces = Pieces(start, part.stop - 1 - int(start[0]))
    shooting = fitter.shooting(FINE, pieces, guess.parameters)
    (model,) = shooting.predict([guess], [settled.states[first : first + 1]])[0]
    (rows,) = _rows(pieces)
    return Run(rows, model)


def _parts(record: AxisRecord, pieces: Pieces) -> list[range]:
    """Return the parts for the trial that have pieces."""
    return [
        part
        for part in record.tried
        if ((pieces.rows >= part.start) & (pieces.rows < part.stop)).any()
    ]


def _rows(pieces: Pieces) -> npt.NDArray[np.int64]:
    return np.asarray(pieces.rows[:, np.newaxis] + 1 + np.arange(pieces.length))
