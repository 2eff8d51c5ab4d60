"""The full-order model, linearised about any operating point: Jacobian, poles, zeros.

States are v, P_A, P_B, nu, nu_dot: the five that the paper counts. The position is their integral:
in a steady motion the chambers' net flows are zero, so to first order neither the volumes nor x act
back.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.errors import OperatingPointError
from hil_bench.abilities.analysis.linearisation import Frequencies, Response
from hil_bench.abilities.analysis.rates import state_rates
from hil_bench.abilities.analysis.steady_motion import OperatingPoint, opening_limits
from hil_bench.extras import require_extra
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
)

Matrix = npt.NDArray[np.float64]


class Input(StrEnum):
    """Inputs of the linear model, in the order of the columns of B and D."""

    SPOOL_SETPOINT = "u"
    LOAD = "F_L"


class Output(StrEnum):
    """Outputs of the linear model, in the order of the rows of C and D."""

    VELOCITY = "v"
    LOAD_PRESSURE = "P_L"
    ORIFICE_STATE = "z"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FullLinearisation:
    """d/dt state = A state + B input, output = C state + D input, about an operating point.

    States v [m/s], P_A, P_B [Pa], nu [m], nu_dot [m/s]; inputs as `Input` [m, N]; outputs as
    `Output` [m/s, Pa, m].

    Attributes:
        operating_point: where.
        A: shape (5, 5).
        B: shape (5, 2).
        C: shape (3, 5).
        D: shape (3, 2), all zero.
    """

    operating_point: OperatingPoint
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """Eigenvalues of A [rad/s], the slowest first."""
        return _by_size(np.linalg.eigvals(_scaled(self.A)).astype(np.complex128))

    @property
    def hydraulic_poles(self) -> npt.NDArray[np.complex128]:
        """The three poles of v, P_A and P_B [rad/s], the slowest first: those without the spool."""
        return _by_size(np.linalg.eigvals(_scaled(self.A)[:3, :3]).astype(np.complex128))

    @property
    def hydraulic_mode(self) -> tuple[float, float] | None:
        """Eigenfrequency [rad/s] and damping ratio of the oscillation of piston on oil, if any."""
        pair = [pole for pole in self.hydraulic_poles if pole.imag > 0.0]
        return (abs(pair[0]), -pair[0].real / abs(pair[0])) if pair else None

    def zeros(self, source: Input, target: Output) -> npt.NDArray[np.complex128]:
        """Return the finite zeros from an input to an output [rad/s], the slowest first."""
        if not self.response(np.ones(1), source, target).any():
            return np.empty(0, dtype=np.complex128)  # nothing arrives, at a closed valve
        require_extra("scipy", "a zero")
        from scipy import linalg  # noqa: PLC0415 - an extra, and slow to import

        column, row = list(Input).index(source), list(Output).index(target)
        driven, seen = self.B[:, column] / _SCALES, self.C[row] * _SCALES
        # s is a zero where [[A - s I, B], [C, D]] loses rank.
        pencil = np.zeros((6, 6))
        pencil[:5, :5] = _scaled(self.A)
        pencil[:5, 5] = driven / np.abs(driven).max()
        pencil[5, :5] = seen / np.abs(seen).max()
        values = linalg.eigvals(pencil, np.diag([1.0] * 5 + [0.0]), homogeneous_eigvals=True)
        finite = np.abs(values[1]) > _AT_INFINITY * np.abs(values[0])
        return _by_size(np.asarray(values[0][finite] / values[1][finite], dtype=np.complex128))

    def response(self, frequencies: Frequencies, source: Input, target: Output) -> Response:
        """Return the frequency response from an input to an output."""
        column, row = list(Input).index(source), list(Output).index(target)
        s = 2j * np.pi * np.asarray(frequencies, dtype=np.float64)[..., np.newaxis, np.newaxis]
        driven = np.broadcast_to(self.B[:, column, np.newaxis], (*s.shape[:-2], 5, 1))
        states = np.linalg.solve(s * np.eye(5) - self.A, driven)[..., 0]
        return np.asarray(states @ self.C[row] + self.D[row, column], dtype=np.complex128)


_SCALES = np.array([1.0, 1e6, 1e6, 1e-3, 1.0])  # of the states, to keep the matrices well behaved
_AT_INFINITY = 1e-9  # s/rad: a zero beyond 1e9 rad/s is none


def linearise_full(
    parameters: PlantParameters, point: OperatingPoint, options: PlantOptions | None = None
) -> FullLinearisation:
    """Return the full-order model linearised about an operating point.

    Central differences of the plant's own right-hand side.

    Args:
        parameters: of the plant.
        point: as `find_operating_point` gives it for the same parameters and options.
        options: what the paper leaves open; None for the paper's reading.
    """
    options = PlantOptions.paper() if options is None else options
    _check_corners(parameters, options, point)
    state, given = np.array(point.state[:6]), np.array(point.plant_input)
    states, inputs = _steps(parameters)

    def rates(state: Matrix, given: Matrix) -> Matrix:
        plant_state, plant_input = PlantState(*map(float, state)), PlantInput(*map(float, given))
        return state_rates(parameters, options, plant_state, plant_input)[1:]

    return FullLinearisation(
        operating_point=point,
        A=np.column_stack(
            [
                (rates(state + step, given) - rates(state - step, given)) / (2.0 * step.max())
                for step in states
            ]
        ),
        B=np.column_stack(
            [
                (rates(state, given + step) - rates(state, given - step)) / (2.0 * step.max())
                for step in inputs
            ]
        ),
        C=_outputs(parameters, options, point),
        D=np.zeros((3, 2)),
    )


def _steps(parameters: PlantParameters) -> tuple[Matrix, Matrix]:
    """Return the disturbances of the five states and of the two inputs, a row each."""
    opening = parameters.full_opening
    sizes = [1e-6, 1e-7 * (parameters.P_S - parameters.P_T), 0.0, 1e-4 * opening, 1e-3]
    sizes[2] = sizes[1]
    return np.diag([0.0, *sizes])[1:], np.diag([1e-4 * opening, 1.0])


def _outputs(parameters: PlantParameters, options: PlantOptions, point: OperatingPoint) -> Matrix:
    alpha, beta = opening_limits(parameters, options, point.spool_position)
    opening = 1.0 if beta < abs(point.spool_position) < alpha + beta else 0.0
    return np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, -1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, opening, 0.0],
        ]
    )


def _check_corners(
    parameters: PlantParameters, options: PlantOptions, point: OperatingPoint
) -> None:
    """Refuse a spool position at which eq. (2) has a corner, so no derivative.

    Raises:
        OperatingPointError: it is at one, or too close.
    """
    alpha, beta = opening_limits(parameters, options, point.spool_position)
    nu, reach = abs(point.spool_position), 2e-4 * (alpha + beta)
    for corner in (beta, alpha + beta):
        if abs(nu - corner) < reach:
            raise OperatingPointError(
                f"spool position {point.spool_position * 1e3:g} mm: eq. (2) has a corner at "
                f"{corner * 1e3:g} mm and no slope; take a point off it by {reach * 1e3:.2g} mm"
            )


def _scaled(matrix: Matrix) -> Matrix:
    scaled: Matrix = matrix * _SCALES / _SCALES[:, np.newaxis]
    return scaled


def _by_size(roots: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    # Rounded: both poles of a pair have the same size, and rounding must not swap them.
    order = np.lexsort((-roots.imag, np.round(np.abs(roots), 6)))
    return roots[order]
