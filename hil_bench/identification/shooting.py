"""The model held against a record in short pieces, each started anew from the record.

Over a whole record the model drifts off wherever the piston sticks and slips, so that far values
of the parameters tell nothing of the near ones. Over a piece of some hundred milliseconds it does
not. The four states at the start of each piece (piston position and velocity, both pressures) are
unknowns too: they start at smoothed measurements, and what a change of them could explain is taken
out of the residuals (variable projection: Kaufman 1975, BIT 15, 49-57).
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.identification.record import AxisRecord
from hil_bench.identification.spool import recorded_spool
from hil_bench.identification.unknowns import Guess
from hil_bench.plant import PlantOptions
from hil_bench.plant.batch import LANES, run_starts, spread_setpoints

Values = npt.NDArray[np.float64]

_STEPS = np.array([1e-8, 1e-6, 10.0, 10.0])
"""Of the start's states for the slopes [m, m/s, Pa, Pa].

Small beside the noise: where a slow piston is about to slip, the motion turns on so little.
"""

_DAMPINGS = np.array([0.0, 1e-2, 1.0, 1e2, 1e4])  # that are tried, times that of the last step
_LEAST_DAMPING, _MOST_DAMPING = 1e-10, 1e6
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
    _setpoints: list[Values] = field(init=False)
    _basis: Values = field(init=False)
    _triangle: Values = field(init=False)
    _damping: Values = field(init=False)

    def __post_init__(self) -> None:
        states, spreads = smooth_states(self.record)
        self._smooth = states[self.pieces.rows]
        self._spreads = _LOOSENESS * spreads
        self.restart()
        rows = self.pieces.rows[:, np.newaxis] + 1 + np.arange(self.pieces.length)
        self._measured = self.record.measured[rows]
        self._setpoints = [
            spread_setpoints(np.repeat(block, self.substeps, axis=1))
            for block in np.split(self.record.setpoints[rows], range(LANES, len(rows), LANES))
        ]
        size = 3 * self.pieces.length + 4
        self._basis = np.zeros((len(rows), size, 4))
        self._triangle = np.tile(np.eye(4), (len(rows), 1, 1))

    def restart(self) -> None:
        """Put the states back to the smoothed measurements."""
        self.states = self._smooth.copy()
        self._damping = np.full(len(self.states), 1e-3)

    @property
    def starts(self) -> dict[int, Values]:
        """The states by the rows at which the pieces start."""
        return dict(zip(self.pieces.rows.tolist(), self.states, strict=True))

    def resume(self, starts: Mapping[int, Values]) -> None:
        """Begin with the states that are known of a row."""
        for number, row in enumerate(self.pieces.rows.tolist()):
            self.states[number] = starts.get(row, self.states[number])

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
        blocks = range(len(self._setpoints))
        jobs = [(number, block) for number in range(len(guesses)) for block in blocks]

        def run(job: tuple[int, int]) -> None:
            number, block = job
            guess, pieces = guesses[number], slice(block * LANES, (block + 1) * LANES)
            starts = np.hstack([states[number][pieces], spools[number][pieces]])
            starts[:, 0] = np.clip(starts[:, 0], -guess.parameters.h, guess.parameters.h)
            seen[number, pieces] = run_starts(
                (guess.parameters, self.options),
                starts,
                self._setpoints[block],
                dt=self.record.interval / self.substeps,
                every=self.substeps,
            )[:, :, [0, 2, 3]]

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(run, jobs))
        for number, guess in enumerate(guesses):
            seen[number, :, :, 1:] += guess.offsets
        return seen

    def residuals(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Return the residuals, in multiples of `scale`, less what other starts could explain.

        Args:
            guesses: the parameters.
            states: for each guess, near those where the starts were settled.

        Returns:
            Shape (guesses, values).
        """
        raw = self._raw(guesses, states)
        raw -= np.einsum("pvk,gpk->gpv", self._basis, np.einsum("pvk,gpv->gpk", self._basis, raw))
        return raw.reshape(len(guesses), -1)

    def settle(self, guess: Guess, enough: float = 1e-6, most: int = 12) -> None:
        """Move the states to where they fit best, and find their slopes there.

        Each piece by itself by Levenberg and Marquardt, several dampings at once.

        Args:
            guess: the parameters.
            enough: relative gain of a step below which it is the last.
            most: steps at most.
        """
        for _ in range(most):
            slopes, raw = self._slopes(guess)
            gain = self._step(guess, slopes, raw)
            if gain <= enough * np.square(raw).sum():
                break
        else:
            slopes, _ = self._slopes(guess)
        self._basis, self._triangle = np.linalg.qr(slopes)

    def follow(self, guess: Guess, others: Sequence[Guess]) -> Values:
        """Return how the states that fit best move from the settled ones, to first order.

        Args:
            guess: for which the states are settled.
            others: close to it.

        Returns:
            Shape (others, pieces, 4).
        """
        raw = self._raw([guess, *others], [self.states] * (1 + len(others)))
        change = np.einsum("pvk,gpv->gpk", self._basis, raw[1:] - raw[0])
        return np.asarray(
            -np.linalg.solve(self._triangle, change[..., np.newaxis])[..., 0] * self._spreads
        )

    def _step(self, guess: Guess, slopes: Values, raw: Values) -> float:
        """Make a step of each piece's states, where one is for the better; return the gain."""
        normal = slopes.transpose(0, 2, 1) @ slopes
        pull = np.einsum("pvk,pv->pk", slopes, raw)
        scale = np.einsum("pkk->pk", normal)[:, :, np.newaxis] * np.eye(4)
        dampings = self._damping * _DAMPINGS[:, np.newaxis]
        damped = normal + dampings[:, :, np.newaxis, np.newaxis] * scale
        shifts = -np.linalg.solve(damped, pull[..., np.newaxis])[..., 0]
        trials = np.concatenate([self.states[np.newaxis], self.states + shifts * self._spreads])
        costs = np.square(self._raw([guess] * len(trials), list(trials))).sum(axis=2)
        best, pieces = np.argmin(costs, axis=0), np.arange(len(self.states))
        self.states = trials[best, pieces]
        # None is for the better: take up where the most careful trial ends.
        factors = np.array([_DAMPINGS[-1], _DAMPINGS[1], *_DAMPINGS[1:]])[best]
        self._damping = np.clip(self._damping * factors, _LEAST_DAMPING, _MOST_DAMPING)
        return float((costs[0] - costs[best, pieces]).sum())

    def misfits(self, guess: Guess) -> Values:
        """Return the rms residual of each piece, as a multiple of the scale, shape (pieces,)."""
        residuals = self.residuals([guess], [self.states]).reshape(len(self.states), -1)
        return np.asarray(np.sqrt(np.square(residuals).mean(axis=1)))

    def deviations(self, guess: Guess, states: Values) -> Values:
        """Return model less record from these states, shape (pieces, rows, 3) [m, Pa, Pa]."""
        return np.asarray(self.predict([guess], [states])[0] - self._measured)

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
