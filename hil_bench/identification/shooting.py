"""The model held against a record in short pieces, each started anew from the record.

Over a whole record the model drifts off wherever the piston sticks and slips, so that far values
of the parameters tell nothing of the near ones. Over a piece of some hundred milliseconds it does
not. The four states at the start of each piece (piston position and velocity, both pressures) are
unknowns too: they start at smoothed measurements, and what a change of them could explain is taken
out of the residuals (variable projection: Kaufman 1975, BIT 15, 49-57).
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.identification.record import AxisRecord
from hil_bench.identification.spool import recorded_spool
from hil_bench.identification.unknowns import Guess
from hil_bench.plant import PlantOptions, PlantState
from hil_bench.plant.batch import LANES, run_plants

Values = npt.NDArray[np.float64]

_STEPS = np.array([1e-6, 1e-4, 1e3, 1e3])  # of the start's states for the slopes [m, m/s, Pa, Pa]
_PARTS = (0.0, 0.03, 0.1, 0.3, 1.0)  # of a step of the starts that are tried
_LOOSENESS = 100.0  # smoothing errs by far more than noise alone where the signals bend
_AWFUL = 1e3  # stands for a residual that is no number
_KEPT_OFF = 3e-3  # [m] from the end stops, whose contact the record does not resolve


class Pieces(NamedTuple):
    """Which pieces of a record.

    Attributes:
        rows: where each starts, ascending.
        length: rows of each.
    """

    rows: npt.NDArray[np.int64]
    length: int

    def share(self, share: float) -> "Pieces":
        """Return some of the pieces, spread evenly by chance; the same at each call."""
        count = max(1, round(share * len(self.rows)))
        chosen = np.random.default_rng(3).permutation(len(self.rows))[:count]
        return Pieces(np.sort(self.rows[chosen]), self.length)

    def chosen(self, which: npt.NDArray[np.bool_]) -> "Pieces":
        """Return the pieces that are marked."""
        return Pieces(self.rows[which], self.length)


def cut_pieces(
    record: AxisRecord, parts: Sequence[range], length: int, stroke_end: float
) -> Pieces:
    """Return the pieces of parts of a record that stay clear of the end stops.

    Args:
        record: what to cut.
        parts: the rows that may be used, without gaps in each.
        length: of each piece, in rows.
        stroke_end: position of the stops [m].
    """
    starts = np.concatenate(
        [np.arange(part.start, part.stop - length, length, dtype=np.int64) for part in parts]
    )
    reach = [np.abs(record.measured[row : row + length + 1, 0]).max() for row in starts]
    return Pieces(starts[np.array(reach, dtype=np.float64) < stroke_end - _KEPT_OFF], length)


@dataclass(slots=True)
class Shooting:
    """Pieces of a record beside the model's run of each.

    Attributes:
        record: the measurement.
        options: of the plant.
        pieces: of the record.
        substeps: solver steps an interval of the record.
        scale: what a residual of each signal counts in, shape (3,).
        states: at the start of each piece, shape (pieces, 4) [m, m/s, Pa, Pa].
    """

    record: AxisRecord
    options: PlantOptions
    pieces: Pieces
    substeps: int
    scale: Values
    states: Values = field(init=False)
    _smooth: Values = field(init=False)
    _spreads: Values = field(init=False)
    _measured: Values = field(init=False)
    _setpoints: Values = field(init=False)
    _basis: Values = field(init=False)

    def __post_init__(self) -> None:
        states, spreads = smooth_states(self.record)
        self._smooth = states[self.pieces.rows]
        self._spreads = _LOOSENESS * spreads
        self.states = self._smooth.copy()
        rows = self.pieces.rows[:, np.newaxis] + 1 + np.arange(self.pieces.length)
        self._measured = self.record.measured[rows]
        self._setpoints = np.repeat(self.record.setpoints[rows], self.substeps, axis=1)
        size = 3 * self.pieces.length + 4
        self._basis = np.zeros((len(self.pieces.rows), size, 4))

    def restart(self) -> None:
        """Put the states back to the smoothed measurements."""
        self.states = self._smooth.copy()

    def predict(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Return what each guess, from the states that go with it, says of each piece.

        Returns:
            Position [m] and the pressures that the sensors show [Pa], shape (guesses, pieces, rows
            of a piece, 3).
        """
        spools = [
            recorded_spool(guess.parameters, self.record)[self.pieces.rows] for guess in guesses
        ]
        seen = np.empty((len(guesses), *self._measured.shape))
        count = len(self.pieces.rows)
        jobs = [
            (number, first) for number in range(len(guesses)) for first in range(0, count, LANES)
        ]

        def run(job: tuple[int, int]) -> None:
            number, first = job
            block = slice(first, first + LANES)
            starts = np.hstack([states[number][block], spools[number][block]])
            starts[:, 0] = np.clip(starts[:, 0], -_end(guesses[number]), _end(guesses[number]))
            seen[number, block] = run_plants(
                [
                    (guesses[number].parameters, self.options, PlantState(*start))
                    for start in starts.tolist()
                ],
                self._setpoints[block],
                dt=self.record.interval / self.substeps,
                every=self.substeps,
            )[:, :, [0, 2, 3]]

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(run, jobs))
        for number, guess in enumerate(guesses):
            seen[number, :, :, 1:] += guess.offsets
        return seen

    def residuals(self, guesses: Sequence[Guess]) -> Values:
        """Return the residuals, in multiples of `scale`, less what other starts could explain.

        Returns:
            Shape (guesses, values).
        """
        raw = self._raw(guesses, [self.states] * len(guesses))
        raw -= np.einsum("pvk,gpk->gpv", self._basis, np.einsum("pvk,gpv->gpk", self._basis, raw))
        return raw.reshape(len(guesses), -1)

    def settle(self, guess: Guess) -> None:
        """Move the states to where they fit best, to first order, and find their slopes there.

        Where a whole step would fit worse, a part of it is made, or none.
        """
        slopes, raw = self._slopes(guess)
        basis, triangle = np.linalg.qr(slopes)
        shift = -np.linalg.solve(triangle, np.einsum("pvk,pv->pk", basis, raw)[..., np.newaxis])
        shift = shift[..., 0] * self._spreads
        trials = np.array([self.states + part * shift for part in _PARTS])
        costs = np.square(self._raw([guess] * len(trials), list(trials))).sum(axis=2)
        best = np.argmin(costs, axis=0)
        self.states = trials[best, np.arange(len(best))]
        self._basis = np.linalg.qr(self._slopes(guess)[0])[0]

    def misfits(self, guess: Guess) -> Values:
        """Return the rms residual of each piece, as a multiple of the scale, shape (pieces,)."""
        residuals = self.residuals([guess]).reshape(len(self.states), -1)
        return np.asarray(np.sqrt(np.square(residuals).mean(axis=1)))

    def deviations(self, guess: Guess) -> Values:
        """Return model less record from the present states, shape (pieces, rows, 3) [m, Pa, Pa]."""
        return np.asarray(self.predict([guess], [self.states])[0] - self._measured)

    def _slopes(self, guess: Guess) -> tuple[Values, Values]:
        """Return the residuals' slopes by the states in their spreads, and the residuals."""
        shifted = [self.states, *(self.states + step for step in np.diag(_STEPS))]
        raw = self._raw([guess] * len(shifted), shifted)
        slopes = (raw[1:] - raw[0]).transpose(1, 2, 0) / _STEPS * self._spreads
        return slopes, raw[0]

    def _raw(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Return residuals of signals and then of the states, shape (guesses, pieces, values)."""
        seen = (self.predict(guesses, states) - self._measured) / self.scale
        seen = np.nan_to_num(seen, nan=_AWFUL, posinf=_AWFUL, neginf=-_AWFUL)
        offsets = np.array([[0.0, 0.0, *guess.offsets] for guess in guesses])[:, np.newaxis]
        starts = (np.array(states) + offsets - self._smooth) / self._spreads
        return np.concatenate([seen.reshape(*seen.shape[:2], -1), starts], axis=2)


def smooth_states(record: AxisRecord) -> tuple[Values, Values]:
    """Return position, velocity and both pressures of each row by Savitzky-Golay filters.

    Returns:
        States, shape (rows, 4) [m, m/s, Pa, Pa], and what noise alone leaves on them, shape (4,).
    """
    from scipy.signal import savgol_coeffs, savgol_filter  # noqa: PLC0415 - an extra

    slope = {"deriv": 1, "delta": record.interval}
    filters: list[tuple[int, dict[str, Any]]] = [
        (0, {"window_length": 7, "polyorder": 3}),
        (0, {"window_length": 7, "polyorder": 3, **slope}),
        (1, {"window_length": 5, "polyorder": 2}),
        (2, {"window_length": 5, "polyorder": 2}),
    ]
    states = np.zeros((len(record), 4))
    for rows in record.stretches:
        part = slice(rows.start, rows.stop)
        for state, (signal, how) in enumerate(filters):
            states[part, state] = savgol_filter(record.measured[part, signal], **how)
    noise = [record.noise[signal] * np.linalg.norm(savgol_coeffs(**how)) for signal, how in filters]
    return states, np.array(noise)


def _end(guess: Guess) -> float:
    return guess.parameters.h
