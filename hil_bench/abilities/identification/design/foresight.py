"""Prediction of a fit's knowledge after a manoeuvre: its Fisher information.

The same pieces, slopes and elimination of the pieces' starts as in the fit itself, on the run of
the model without noise. Residuals with independent normal noise have the information J' J, where J
are their slopes in multiples of the noise (Ljung, System Identification, 2nd ed. 1999, section
7.4); that of runs of one recording adds up.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.fit import Fitter
from hil_bench.abilities.identification.pieces import Pieces, cut_pieces
from hil_bench.abilities.identification.quadratic import project
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.spool import fit_spool
from hil_bench.abilities.identification.stages import FINE, LENGTH
from hil_bench.abilities.identification.stops import find_stops
from hil_bench.abilities.identification.tangent import Tangents
from hil_bench.abilities.identification.uncertainty import invert, leave_out_wild
from hil_bench.abilities.identification.unknowns import PROMPT, SENSING, Guess, Unknowns

Values = npt.NDArray[np.float64]

_SETTLED = 20  # rows at the start, as the fit leaves them out


@dataclass(frozen=True, slots=True)
class Foresight:
    """Foresees fits to runs of a twin.

    Attributes:
        twin: of the machine.
        unknowns: of the fit; the spool's are not among them where its position is recorded.
        start: the free variables of the twin, shape (variables,).
    """

    twin: Twin
    unknowns: Unknowns
    start: Values = field(init=False)

    def __post_init__(self) -> None:
        guess = Guess(self.twin.parameters, np.zeros((1, 2)), self.twin.sensors)
        object.__setattr__(self, "start", self.unknowns.variables_of(guess))

    def information(self, setpoints: Values, states: Values, end: int | None = None) -> Values:
        """Return the information of a run on the free variables, offsets of the sensors among them.

        Args:
            setpoints: of each row, as shares of the full opening, shape (rows,).
            states: of each row, as `Twin.run` returns them.
            end: the row at which the part for the fit ends; None for the last.

        Returns:
            Shape (variables, variables); zero where nothing can be fitted to.
        """
        record = self.twin.record(setpoints, states)
        if self.twin.options.end_stop is not None:
            record = find_stops(record, self.twin.parameters.h)
        part = range(_SETTLED, len(setpoints) if end is None else end)
        rows = record.rows_in(LENGTH)
        nothing = np.zeros((len(self.start), len(self.start)))
        if len(part) <= rows:
            return nothing
        pieces = cut_pieces(record, [part], rows, self.twin.parameters.h, has_stops=True)
        if not len(pieces.rows):
            return nothing
        return self._of_pieces(record, pieces, states)

    def spool_deviations(self, setpoints: Values, states: Values) -> dict[str, float]:
        """Return the standard deviations of the spool's parameters by its recorded position [SI].

        Empty where it is not recorded, or does not tell them.
        """
        if not self.twin.has_spool:
            return {}
        record = self.twin.record(setpoints, states)
        found = fit_spool(record, self.twin.parameters)
        return {name: deviation for name, (_, deviation) in found.items()}

    def reduce(self, information: Values) -> Values:
        """Return the information on the sought parameters, whatever the sensors' offsets are."""
        count = len(self.unknowns.names)
        own, mixed = information[:count, :count], information[:count, count:]
        expected = np.diag(self.unknowns.spreads[count:] ** -2.0)
        offsets = information[count:, count:] + expected
        return np.asarray(own - mixed @ np.linalg.solve(offsets, mixed.T))

    def prior(self, covariance: Values | None = None) -> Values:
        """Return the information on the sought parameters before a run.

        Args:
            covariance: of the sought parameters [SI]; None where none was identified yet, and only
                what is expected of them is known.
        """
        count = len(self.unknowns.names)
        expected = np.diag(self.unknowns.spreads[:count] ** -2.0)
        if covariance is None:
            return np.asarray(expected)
        slopes = self.slopes_si()
        variables = np.linalg.solve(slopes, np.linalg.solve(slopes, covariance).T)
        # Nothing is known less well than what is expected anyway.
        return np.asarray(invert(0.5 * (variables + variables.T)) + 1e-3 * expected)

    def slopes_si(self) -> Values:
        """Return the slopes of the sought parameters [SI] by their free variables."""
        count = len(self.unknowns.names)
        return self.unknowns.slopes_si(self.start)[:count, :count]

    def _of_pieces(self, record: AxisRecord, pieces: Pieces, states: Values) -> Values:
        twin, unknowns = self.twin, self.unknowns
        is_behind = twin.sensors != PROMPT or not set(SENSING).isdisjoint(unknowns.names)
        fitter = Fitter(record, twin.options, twin.step, is_behind=is_behind)
        guess = unknowns.guess(self.start)
        shooting = fitter.shooting(FINE, pieces, twin.parameters)
        shooting.states = states[pieces.rows]
        shooting.settle(guess, most=0)
        steady = np.flatnonzero(~shooting.turns_on_a_hair())
        if not len(steady):
            return np.zeros((len(self.start), len(self.start)))
        slopes = project(Tangents(unknowns, shooting.part(steady)).at(self.start))
        slopes = slopes[leave_out_wild(slopes)]
        flat = slopes.reshape(-1, slopes.shape[-1])
        return np.asarray(flat.T @ flat)
