"""Prediction of a fit's knowledge after a manoeuvre: its Fisher information.

The same strokes and slopes as in the fit itself, on the run of the model without noise. Residuals
with independent normal noise have the information J' J, where J are their slopes in multiples of
the noise (Ljung, System Identification, 2nd ed. 1999, section 7.4); that of runs of one recording
adds up.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.fit import Bench, Problem
from hil_bench.abilities.identification.machine import Template, Unknown
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

_OFFSETS = ("offset_a:0", "offset_b:0")
TOLD = 0.1
"""Standard deviation of a free variable up to which a run tells a parameter."""


def invert(matrix: Values) -> Values:
    """Return the inverse of an information, also where it is nearly singular."""
    return np.asarray(np.linalg.pinv(matrix, rcond=1e-14, hermitian=True))


@dataclass(frozen=True, slots=True)
class Foresight:
    """Foresees fits to runs of a twin.

    Attributes:
        twin: of the machine.
        template: the same machine, for the fit.
        names: of the sought parameters.
        unknowns: of the fit, offsets of the sensors last.
    """

    twin: Twin
    template: Template
    names: tuple[str, ...]
    unknowns: tuple[Unknown, ...] = field(init=False)

    def __post_init__(self) -> None:
        unknowns = tuple(map(self.template.unknown, (*self.names, *_OFFSETS)))
        object.__setattr__(self, "unknowns", unknowns)

    @property
    def start(self) -> Values:
        """The free variables of the twin, shape (variables,)."""
        return np.array([one.start for one in self.unknowns])

    def information(self, setpoints: Values, states: Values) -> Values:
        """Return the information of a run on the free variables, offsets of the sensors among them.

        Args:
            setpoints: of each row, as shares of the full opening, shape (rows,).
            states: of each row, as `Twin.run` returns them.

        Returns:
            Shape (variables, variables); zero where nothing can be fitted to.
        """
        record = self.twin.record(setpoints, states)
        try:
            course = make_course(record, record.interval)
        except ConfigError:
            return np.zeros((len(self.unknowns), len(self.unknowns)))
        noise = np.where(np.isfinite(self.twin.noise), self.twin.noise, 1.0)
        bench = Bench(self.template, course, self.twin.step, noise)
        problem = Problem(bench, self.unknowns)
        slopes = problem.slopes(self.start)[: sum(problem.lengths)]
        return np.asarray(slopes.T @ slopes)

    def reduce(self, information: Values) -> Values:
        """Return the information on the sought parameters, whatever the sensors' offsets are."""
        count = len(self.names)
        own, mixed = information[:count, :count], information[:count, count:]
        spreads = np.array([one.spread for one in self.unknowns[count:]])
        offsets = information[count:, count:] + np.diag(spreads**-2.0)
        return np.asarray(own - mixed @ np.linalg.solve(offsets, mixed.T))

    def prior(self) -> Values:
        """Return the information on the sought parameters before a run, as expected of them."""
        spreads = np.array([one.spread for one in self.unknowns[: len(self.names)]])
        return np.asarray(np.diag(spreads**-2.0))
