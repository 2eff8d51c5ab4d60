"""The model held against a record in short pieces, each started anew from the record.

Over a whole record the model drifts off wherever the piston sticks and slips, so that far values
of the parameters tell nothing of the near ones. Over a piece of some hundred milliseconds it does
not. The four states at the start of each piece (piston position and velocity, both pressures) are
unknowns too: they start at smoothed measurements, and what a change of them could explain is taken
out of the residuals (variable projection: Kaufman 1975, BIT 15, 49-57).
"""

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.loss import cost_of, pull_of
from hil_bench.abilities.identification.pieces import Pieces
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.sensing import sense
from hil_bench.abilities.identification.spool import recorded_spool
from hil_bench.abilities.identification.unknowns import PROMPT, Guess
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.batch import (
    LANES,
    NO_CUTS,
    Cuts,
    run_starts,
    spread_setpoints,
)
from hil_bench.plants.hydraulic_cylinder.model.cuts import OPEN
from hil_bench.plants.hydraulic_cylinder.model.extended_batch import run_extended_starts

Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_STEPS = np.array([1e-8, 1e-6, 10.0, 10.0])
"""Longest steps of the start's states for the slopes [m, m/s, Pa, Pa]."""

SMALL = 0.03
"""Norm of a piece's change beyond which a step for slopes is shortened: small beside the noise.

Where a slow piston is about to slip, a longer step gives a chord, not a slope, and the fit stops
short of the optimum.
"""

_HAIR = 30.0  # times the median piece's: a start of which so much comes amplifies its own errors
_SANE = 100.0  # times the spreads
_LOST = 1.3  # times the median rms: a piece whose start may sit in a side minimum of its own

_DAMPINGS = np.array([0.0, 1e-2, 1.0, 1e2, 1e4])  # that are tried, times that of the last step
ROUNDING = 1e-12
"""Damping of the same order as rounding, which keeps any matrix regular."""

_LEAST_DAMPING, _FIRST_DAMPING, _MOST_DAMPING = 1e-10, 1e-3, 1e6
_FINEST = 5  # parts of a row
BLIND = (
    0.012,
    0.003,
)  # [s] at the begin and the end of a piece that sensors which are behind spoil
_SUNK = 1e-3  # [m] that a piston may be in its stop
_AWFUL = 1e3  # stands for a residual that is no number


@dataclass(slots=True)
class Shooting:
    """Pieces of a record beside the model's run of each.

    Attributes:
        record: the measurement.
        options: of the plant.
        pieces: of the record.
        substeps: solver steps an interval of the record.
        scale: what a residual of each signal counts in, shape (3,).
        smoothed: the states of the whole record and their spreads, as `smooth_states` gives them.
        knee: of the loss under which starts settle, in multiples of the scale.
        is_behind: whether the sensors are; the ends of the pieces, where they show what was before
            the start, count for nothing then.
        states: at the start of each piece, shape (pieces, 4) [m, m/s, Pa, Pa].
        spreads: of the states about the smoothed measurements, shape (pieces, 4).
        steps: of the states for slopes, shape (pieces, 4).
        damping: of each piece's next step of its states, shape (pieces,).
        has: which signals the record has in each piece, shape (pieces, 3).
        is_there: which residuals of the signals count, shape (pieces, rows, 3).
    """

    record: AxisRecord
    options: PlantOptions
    pieces: Pieces
    substeps: int
    scale: Values
    smoothed: tuple[Values, Values]
    knee: float = np.inf
    is_behind: bool = False
    states: Values = field(init=False)
    spreads: Values = field(init=False)
    steps: Values = field(init=False)
    damping: Values = field(init=False)
    has: Marks = field(init=False)
    is_there: Marks = field(init=False)
    _smooth: Values = field(init=False)
    _measured: Values = field(init=False)
    _session: npt.NDArray[np.int64] = field(init=False)
    _blocks: list[slice] = field(init=False)
    _setpoints: list[Values] = field(init=False)
    _cuts: list[Cuts] = field(init=False, default_factory=list)
    _basis: Values = field(init=False)
    _sizes: Values = field(init=False)

    def __post_init__(self) -> None:
        states, spreads = self.smoothed
        self._smooth, self.spreads = states[self.pieces.rows], spreads[self.pieces.rows]
        self._session = self.record.session_of(self.pieces.rows)
        self.has = self.record.has_at(self.pieces.rows)
        self.restart()
        rows = self.pieces.rows[:, np.newaxis] + 1 + np.arange(self.pieces.length)
        self._measured = self.record.measured[rows]
        self._blocks = _cut_blocks(self._session)
        self._setpoints = [
            spread_setpoints(np.repeat(self.record.setpoints[rows[block]], self.substeps, axis=1))
            for block in self._blocks
        ]
        self.is_there = self.record.counts_at(rows)
        if self.is_behind:
            begin, end = (math.ceil(span / self.record.interval) for span in BLIND)
            self.is_there[:, :begin] = False
            self.is_there[:, self.pieces.length - end :] = False
        size = 3 * self.pieces.length + 4
        self._basis = np.zeros((len(rows), size, 4))
        self._sizes = np.zeros((len(rows), 4))

    def restart(self) -> None:
        """Put the states back to the smoothed measurements."""
        self.states = self._smooth.copy()
        self.damping = np.full(len(self.states), _FIRST_DAMPING)
        self.steps = np.tile(_STEPS, (len(self.states), 1))

    @property
    def starts(self) -> dict[int, Values]:
        """The states by the rows at which the pieces start."""
        return dict(zip(self.pieces.rows.tolist(), self.states, strict=True))

    def resume(self, starts: Mapping[int, Values]) -> None:
        """Begin with the states that are known of a row."""
        for number, row in enumerate(self.pieces.rows.tolist()):
            self.states[number] = starts.get(row, self.states[number])

    def predict(
        self,
        guesses: Sequence[Guess],
        states: Sequence[Values],
        cuts: Sequence[Cuts] | None = None,
    ) -> Values:
        """Predict each piece by each guess, from the states that go with it.

        Args:
            guesses: the parameters.
            states: for each guess, at the start of each piece.
            cuts: of the solver's steps, block by block, as `run_starts` takes them.

        Returns:
            Position [m] and the pressures that the sensors show [Pa], shape (guesses, pieces, rows
            of a piece, 3).
        """
        spools = [
            recorded_spool(guess.parameters, self.record)[self.pieces.rows] for guess in guesses
        ]
        seen = np.empty((len(guesses), *self._measured.shape))
        blocks = range(len(self._blocks))
        jobs = [(number, block) for number in range(len(guesses)) for block in blocks]

        def show(job: tuple[int, int]) -> None:
            number, block = job
            pieces = self._blocks[block]
            starts = np.hstack([states[number][pieces], spools[number][pieces]])
            guess, known = guesses[number], None if cuts is None else cuts[block]
            fine = self._fineness if guess.sensors != PROMPT else 1
            run = self._run(guess, block, starts, known, self.substeps // fine)
            shown = run[:, :, [0, 2, 3]]
            if guess.sensors != PROMPT:
                begin = starts[:, np.newaxis, [0, 2, 3]]
                whole = np.concatenate([begin, shown], axis=1)
                shown = sense(whole, self.record.interval / fine, guess.sensors, fine)
            seen[number, pieces] = shown

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(show, jobs))
        for number, guess in enumerate(guesses):
            seen[number, :, :, 1:] += guess.offsets[self._session][:, np.newaxis]
        return seen

    def residuals(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Return the residuals, in multiples of `scale`, less what other starts could explain.

        Args:
            guesses: the parameters.
            states: for each guess, near those where the starts were settled.

        Returns:
            Shape (guesses, values).
        """
        raw = self.raw(guesses, states)
        raw -= np.einsum("pvk,gpk->gpv", self._basis, np.einsum("pvk,gpv->gpk", self._basis, raw))
        return raw.reshape(len(guesses), -1)

    def settle(self, guess: Guess, enough: float = 1e-6, most: int = 12) -> None:
        """Move the states to where they fit best, and find their slopes there.

        Each piece by itself by Levenberg and Marquardt, several dampings at once.

        Args:
            guess: the parameters.
            enough: relative gain of a step below which it is a piece's last.
            most: steps at most.
        """
        moving = np.arange(len(self.states))
        for _ in range(most):
            part = self.part(moving)
            gains = part.advance(guess)
            self._take(part, moving)
            moving = moving[gains > enough]
            if not len(moving):
                break
        _, slopes = self.slopes(guess)
        self._sizes = np.linalg.norm(slopes, axis=1)
        self._basis, _ = np.linalg.qr(slopes)

    def advance(self, guess: Guess) -> Values:
        """Make a step of each piece's states, where one is for the better.

        Returns:
            By how much the cost of each piece has fallen, of what it was.
        """
        raw, slopes = self.slopes(guess)
        weights = pull_of(raw, self.knee)
        normal = slopes.transpose(0, 2, 1) @ (slopes * weights[..., np.newaxis])
        pull = np.einsum("pvk,pv->pk", slopes, raw * weights)
        scale = np.einsum("pkk->pk", normal)[:, :, np.newaxis] * np.eye(4)
        dampings = np.maximum(self.damping * _DAMPINGS[:, np.newaxis], ROUNDING)
        damped = normal + dampings[:, :, np.newaxis, np.newaxis] * scale
        shifts = -np.linalg.solve(damped, pull[..., np.newaxis])[..., 0]
        trials = np.concatenate([self.states[np.newaxis], self.states + shifts * self.spreads])
        costs = self._costs(self.raw([guess] * len(trials), list(trials)))
        best, pieces = np.argmin(costs, axis=0), np.arange(len(self.states))
        self.states = trials[best, pieces]
        # None is for the better: take up where the most careful trial ends.
        factors = np.array([_DAMPINGS[-1], _DAMPINGS[1], *_DAMPINGS[1:]])[best]
        self.damping = np.clip(self.damping * factors, _LEAST_DAMPING, _MOST_DAMPING)
        return np.asarray(1.0 - costs[best, pieces] / np.maximum(costs[0], 1e-300))

    def relay(self, guess: Guess) -> None:
        """Settle pieces that fit badly anew, from where the run of the piece before has ended.

        Where the piston sticks and slips, a smoothed start may be a whole cycle off.
        """
        misfits = self.misfits(guess)
        follows = np.append(False, np.diff(self.pieces.rows) == self.pieces.length)
        ends = np.roll(self._ends(guess), 1, axis=0)
        # A wrong guess may diverge.
        is_sane = (np.abs(ends - self._smooth) < _SANE * self.spreads).all(axis=1)
        lost = np.flatnonzero((misfits > _LOST * np.median(misfits)) & follows & is_sane)
        if not len(lost):
            return
        again = self.part(lost)
        again.states = ends[lost]
        again.settle(guess)
        better = again.misfits(guess) < misfits[lost]
        self.states[lost[better]] = again.states[better]

    def slopes(self, guess: Guess) -> tuple[Values, Values]:
        """Return the residuals, and their slopes by the states in their spreads.

        The next steps for slopes are short enough for each piece.
        """
        here = self.anchor(guess)
        moved = [self.states + self.steps * one for one in np.eye(4)]
        raw = self.beside([guess] * 4, moved)
        slopes = (raw - here).transpose(1, 2, 0) / self.steps[:, np.newaxis]
        self.shorten(np.linalg.norm(slopes, axis=1))
        return here, slopes * self.spreads[:, np.newaxis]

    def shorten(self, sizes: Values) -> None:
        """Make the steps for slopes small beside the noise, by the norms of the slopes."""
        self.steps = np.minimum(_STEPS, SMALL / np.maximum(sizes, 1e-9))

    def copy(self) -> "Shooting":
        """Return the same with states of its own."""
        return self.part(np.arange(len(self.states)))

    def part(self, which: npt.NDArray[np.int64]) -> "Shooting":
        """Return some of the pieces, with their states."""
        pieces = Pieces(self.pieces.rows[which], self.pieces.length)
        part = replace(self, pieces=pieces)
        part.states, part.steps = self.states[which], self.steps[which]
        part.damping = self.damping[which]
        return part

    def _take(self, part: "Shooting", which: npt.NDArray[np.int64]) -> None:
        """Take over the states of some of the pieces."""
        self.states[which], self.steps[which] = part.states, part.steps
        self.damping[which] = part.damping

    def misfits(self, guess: Guess) -> Values:
        """Return the rms residual of each piece, as a multiple of the scale, shape (pieces,)."""
        (raw,) = self.raw([guess], [self.states])
        values = self.is_there.sum(axis=(1, 2)) + 4
        return np.asarray(np.sqrt(np.square(raw).sum(axis=1) / values))

    def turns_on_a_hair(self) -> Marks:
        """Return in which pieces the motion amplifies the slightest error of the settled start."""
        return np.asarray((self._sizes > _HAIR * np.median(self._sizes, axis=0)).any(axis=1))

    def deviations(self, guess: Guess, states: Values) -> Values:
        """Return model less record from these states, shape (pieces, rows, 3) [m, Pa, Pa].

        It is not a number where the record lacks a signal.
        """
        return np.asarray(self.predict([guess], [states])[0] - self._measured)

    @property
    def _fineness(self) -> int:
        """Parts of a row in which sensors see the motion."""
        return max(part for part in range(1, _FINEST + 1) if self.substeps % part == 0)

    def _costs(self, raw: Values) -> Values:
        return np.asarray(cost_of(raw, self.knee).sum(axis=-1))

    def _ends(self, guess: Guess) -> Values:
        """Return the states that the model has at the end of each piece, shape (pieces, 4)."""
        spool = recorded_spool(guess.parameters, self.record)[self.pieces.rows]
        ends = np.empty_like(self.states)
        for block in range(len(self._blocks)):
            part = self._blocks[block]
            starts = np.hstack([self.states[part], spool[part]])
            ends[part] = self._run(guess, block, starts)[:, -1, :4]
        return ends

    def _run(
        self,
        guess: Guess,
        block: int,
        starts: Values,
        cuts: Cuts | None = None,
        every: int | None = None,
    ) -> Values:
        """Run a plant in the pieces of a block and return its outputs, as `run_starts` does."""
        parameters = guess.plant_in(int(self._session[self._blocks[block].start]))
        furthest = parameters.h + _SUNK
        starts[:, 0] = np.clip(starts[:, 0], -furthest, furthest)
        run = run_extended_starts if self.options.is_extended else run_starts
        return run(
            (parameters, self.options),
            starts,
            self._setpoints[block],
            dt=self.record.interval / self.substeps,
            every=every or self.substeps,
            cuts=NO_CUTS if cuts is None else cuts,
        )

    def anchor(self, guess: Guess) -> Values:
        """Return the residuals from `states`, shape (pieces, values), and keep the steps' cuts.

        `beside` follows them.
        """
        self._cuts = [np.full_like(block, OPEN, dtype=np.int64) for block in self._setpoints]
        return np.asarray(self._residuals([guess], [self.states], self._cuts)[0])

    def beside(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Act as `raw`, with the solver's steps cut as where `anchor` was."""
        return self._residuals(guesses, states, self._cuts)

    def raw(self, guesses: Sequence[Guess], states: Sequence[Values]) -> Values:
        """Return residuals of signals and then of the states, shape (guesses, pieces, values)."""
        return self._residuals(guesses, states, None)

    def _residuals(
        self, guesses: Sequence[Guess], states: Sequence[Values], cuts: Sequence[Cuts] | None
    ) -> Values:
        seen = (self.predict(guesses, states, cuts) - self._measured) / self.scale
        seen = np.nan_to_num(seen, nan=_AWFUL, posinf=_AWFUL, neginf=-_AWFUL)
        seen *= self.is_there
        starts = np.array(states) - self._smooth
        offsets = np.array([guess.offsets[self._session] for guess in guesses])
        starts[..., 2:] += offsets * self.has[:, 1:]
        starts /= self.spreads
        return np.concatenate([seen.reshape(*seen.shape[:2], -1), starts], axis=2)


def _cut_blocks(session: npt.NDArray[np.int64]) -> list[slice]:
    """Return the pieces that run side by side, at most `LANES` of one recording."""
    edges = [0, *(np.flatnonzero(np.diff(session)) + 1).tolist(), len(session)]
    return [
        slice(first, min(first + LANES, stop))
        for start, stop in itertools.pairwise(edges)
        for first in range(start, stop, LANES)
    ]
