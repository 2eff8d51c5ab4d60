"""The end of a fit: Gauss-Newton steps of the parameters and of all starts together.

The starts of a piece touch that piece alone, so they are eliminated piece by piece, and a step
costs one system of the size of the parameters. The fit ends where the gradient is as good as zero
and a step gains nothing, not where progress is slow.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.loss import cost_of
from hil_bench.abilities.identification.quadratic import (
    Quadratic,
    find_deviations,
    project,
    step_down,
)
from hil_bench.abilities.identification.shooting import Shooting
from hil_bench.abilities.identification.tangent import Tangent, Tangents
from hil_bench.abilities.identification.uncertainty import leave_out_wild
from hil_bench.abilities.identification.unknowns import Unknowns

Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

REACHED = 0.02
"""Newton decrement below which the gradient is as good as zero.

It is the distance to the optimum, in standard deviations of the parameters for noise of the
expected size.
"""

GAINED = 0.02
"""Gain of a step below which it is as good as nothing.

One standard deviation off the optimum costs 0.5.
"""

MOST_STEPS = 40
_MEASURED = 1.0  # decrement below which the gradient is measured
_REACH = 0.5  # deviations, over which it is
_IDLE = 5  # steps one after the other that gain nothing
_STUCK = 0.1  # of the cost, that a piece's start could still gain
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-8, 1e8
_EASE, _TIGHTEN = 0.1, 10.0
_OWN = np.array([0.0, 1.0, 1e2, 1e4, 1e12])  # dampings of a start that are tried, times its last
_NEXT_OWN = np.array([0.1, 1.0, 1e2, 1e4, 1e4])  # and its next damping, likewise
_LEAST_OWN, _FIRST_OWN, _MOST_OWN = 1e-8, 1e-4, 1e4


@dataclass(frozen=True, slots=True)
class Optimum:
    """The end of a polish.

    Attributes:
        variables: the free variables.
        cost: the loss of all residuals.
        decrement: Newton decrement: how far the optimum is, in deviations.
        gain: of the cost in the last step.
        steps: how many were made.
        residuals: of the pieces, shape (pieces, values).
        slopes: of the residuals by the variables, less what the pieces' own starts could explain,
            shape (pieces, values, variables).
        is_stuck: in which pieces the start is not at its best, shape (pieces,).
    """

    variables: Values
    cost: float
    decrement: float
    gain: float
    steps: int
    residuals: Values
    slopes: Values
    is_stuck: Marks

    @property
    def is_reached(self) -> bool:
        """Return True if gradient and gain are as good as zero."""
        return bool(self.decrement <= REACHED and self.gain <= GAINED)


@dataclass(slots=True)
class Polish:
    """The fit of unknowns to pieces by Gauss-Newton steps.

    Attributes:
        unknowns: what is sought.
        shooting: the pieces beside the model, with the starts near their best.
        held: the number of a variable that stays, if any does.
    """

    unknowns: Unknowns
    shooting: Shooting
    held: int | None = None
    _tangents: Tangents = field(init=False)
    _own_damping: Values = field(init=False)

    def __post_init__(self) -> None:
        self._tangents = Tangents(self.unknowns, self.shooting)
        self._own_damping = np.full(len(self.shooting.states), _FIRST_OWN)

    def run(
        self,
        variables: Values,
        report: Callable[[], None],
        most: int = MOST_STEPS,
        near: float = 0.0,
    ) -> Optimum:
        """Return the optimum next to these variables; the starts end there too.

        Args:
            variables: where to start.
            report: is called after each step.
            most: steps at most.
            near: decrement below which a step is the last, whether the optimum is reached or not.
        """
        damping, idle = _FIRST_DAMPING, 0
        (costs,) = self._costs(variables, [self.shooting.states])
        cost = float(costs.sum()) + self._expect(variables)
        optimum, quadratic = self._look(variables, cost)
        is_near = False
        while not optimum.is_reached and optimum.steps < most and idle < _IDLE:
            if optimum.decrement < near:
                break
            found = self._step(optimum, quadratic, damping, GAINED if is_near else 0.0)
            if found is None:
                return replace(optimum, gain=0.0)
            variables, cost, damping = found
            gain, steps = optimum.cost - cost, optimum.steps + 1
            idle = idle + 1 if gain <= GAINED else 0
            damping = max(_EASE * damping, _LEAST_DAMPING)
            is_near = is_near or optimum.decrement < _MEASURED
            optimum, quadratic = self._look(variables, cost, is_near=is_near)
            optimum = replace(optimum, gain=gain, steps=steps)
            report()
        return optimum

    def _look(
        self, variables: Values, cost: float, *, is_near: bool = False
    ) -> tuple[Optimum, Quadratic]:
        """Return the distance to the optimum, and the cost about this point."""
        tangent = self._tangents.at(variables)
        slopes = project(tangent)
        is_tame = leave_out_wild(slopes)
        kept = is_tame[:, np.newaxis, np.newaxis]
        tangent, slopes = tangent._replace(slopes=tangent.slopes * kept), slopes * kept
        quadratic = Quadratic.of(tangent, self._expected(variables), self.unknowns.spreads)
        quadratic = self._bend(variables, tangent, quadratic)
        if is_near:
            quadratic = self._measure_pull(variables, quadratic, is_tame)
        pull, information = quadratic.reduce(np.zeros(len(quadratic.own)))
        step = step_down(pull, information, self._free(variables, pull), damping=0.0)
        return Optimum(
            variables=variables,
            cost=cost,
            decrement=float(np.sqrt(max(0.0, -float(pull @ step)))),
            gain=np.inf,
            steps=0,
            residuals=tangent.raw,
            slopes=slopes,
            is_stuck=quadratic.own_gains() > _STUCK,
        ), quadratic

    def _step(
        self, here: Optimum, quadratic: Quadratic, damping: float, slack: float
    ) -> tuple[Values, float, float] | None:
        """Make a step that lowers the cost; return variables, cost and damping, None for none.

        Each piece's start goes as far as is best for it, so that no piece holds up the others. The
        cost may rise by `slack`: where it jumps by more than a step gains, the gradient measured
        over half a deviation knows better.
        """
        pull, information = quadratic.reduce(self._own_damping)
        free = self._free(here.variables, pull)
        dampings = np.outer(_OWN, self._own_damping)
        pieces = np.arange(len(quadratic.own))
        while damping <= _MOST_DAMPING:
            step = step_down(pull, information, free, damping)
            trial = np.clip(here.variables + step, *self.unknowns.bounds)
            moves = [quadratic.follow(trial - here.variables, own) for own in dampings]
            states = self.shooting.states + np.array(moves) * self.shooting.spreads
            costs = self._costs(trial, list(states))
            best = np.argmin(costs, axis=0)
            cost = float(costs[best, pieces].sum()) + self._expect(trial)
            if cost < here.cost + slack:
                self.shooting.states = states[best, pieces]
                found = self._own_damping * _NEXT_OWN[best]
                self._own_damping = np.clip(found, _LEAST_OWN, _MOST_OWN)
                return trial, cost, damping
            damping *= _TIGHTEN
        return None

    def _bend(self, variables: Values, tangent: Tangent, quadratic: Quadratic) -> Quadratic:
        """Return the quadratic with the cost's true bend along each start's vaguest direction.

        Along it the residuals hardly change to first order, so that what bends the cost is their
        second derivative, which Gauss-Newton leaves out: it would see gains that are not there.
        """
        direction, size = quadratic.vaguest()
        move = direction * size[:, np.newaxis] * self.shooting.spreads
        ends = [self.shooting.states + move, self.shooting.states - move]
        above, below = self._costs(variables, ends)
        here = cost_of(tangent.raw).sum(axis=1)
        return quadratic.bent(direction, (above + below - 2.0 * here) / size**2)

    def _measure_pull(self, variables: Values, quadratic: Quadratic, is_tame: Marks) -> Quadratic:
        """Return the quadratic with the gradient that the cost has over half a deviation.

        The solver's motion jumps a little where it crosses a branch, and one slope that is a
        difference across a jump outweighs the gradient that is left near the optimum. Slopes count
        along directions in which the cost is no parabola that far off, as where nothing is known.
        """
        pull, information = quadratic.reduce(np.zeros(len(quadratic.own)))
        free = self._free(variables, pull)
        ways = np.zeros((int(free.sum()), len(variables)))
        ways[:, free] = _REACH * find_deviations(information[np.ix_(free, free)])
        rises, steps = [], []
        for sign in (1.0, -1.0):
            trials = np.clip(variables + sign * ways, *self.unknowns.bounds)
            steps.append(trials - variables)
            bends = 0.5 * np.einsum("wv,vu,wu->w", steps[-1], information, steps[-1])
            rises.append(self._follow(trials, steps[-1], quadratic, is_tame) - bends)
        here = self._follow(variables[np.newaxis], np.zeros_like(ways[:1]), quadratic, is_tame)
        is_parabola = np.abs(rises[0] + rises[1] - 2.0 * here) < _REACH**2
        across = (steps[0] - steps[1])[:, free]
        found = pull.copy()
        measured = np.where(is_parabola, rises[0] - rises[1], across @ pull[free])
        found[free] = np.linalg.solve(across, measured)
        return quadratic._replace(pull=quadratic.pull + found - pull)

    def _follow(
        self, trials: Values, steps: Values, quadratic: Quadratic, is_tame: Marks
    ) -> Values:
        """Return the cost at each of some trials that lie steps away, the starts following."""
        guesses = [self.unknowns.guess(trial) for trial in trials]
        moves = np.array([quadratic.swing(step) for step in steps])
        states = self.shooting.states + moves * self.shooting.spreads
        costs = cost_of(self.shooting.raw(guesses, list(states))).sum(axis=2)
        return np.asarray(costs @ is_tame + [self._expect(trial) for trial in trials])

    def _costs(self, variables: Values, states: list[Values]) -> Values:
        """Return the cost of each piece from each of some states, shape (states, pieces)."""
        guesses = [self.unknowns.guess(variables)] * len(states)
        return np.asarray(cost_of(self.shooting.raw(guesses, states)).sum(axis=2))

    def _expect(self, variables: Values) -> float:
        """Return the cost of the variables' distance from what was expected of them."""
        return 0.5 * float(np.square(self._expected(variables)).sum())

    def _expected(self, variables: Values) -> Values:
        return np.asarray((variables - self.unknowns.start) / self.unknowns.spreads)

    def _free(self, variables: Values, pull: Values) -> Marks:
        """Mark the variables that may move: neither held, nor pressed against a bound."""
        lowest, highest = self.unknowns.bounds
        is_held = ((variables <= lowest) & (pull > 0.0)) | ((variables >= highest) & (pull < 0.0))
        if self.held is not None:
            is_held[self.held] = True
        return np.asarray(~is_held)
