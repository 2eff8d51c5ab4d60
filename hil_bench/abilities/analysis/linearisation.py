"""The model linearised about an operating point, reduced and in full."""

import cmath
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.steady_motion import (
    OperatingPoint,
    OperatingPointError,
    opening_limits,
    state_rates,
)
from hil_bench.errors import ParameterError, require_extra
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
)

# The reduced model, linearised: eqs. (18)-(20) from flow to velocity, (21)-(24) with the valve.
#
# Ruderman 2017, section IV-A. Symbols in words: eigenfrequency omega_c, damping ratio zeta, flow
# gain C_q, flow-pressure coefficient C_qp, orifice state z, load pressure P_L.

Frequencies = npt.NDArray[np.float64]
"""Frequencies [Hz], any shape."""

Response = npt.NDArray[np.complex128]
"""A frequency response, in the shape of its frequencies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondOrderSystem:
    """A gain and a pair of poles: gain / ((s / omega)² + 2 zeta s / omega + 1).

    Attributes:
        gain: at standstill, in the unit of output / input.
        eigenfrequency: omega [rad/s].
        damping_ratio: zeta [-].
    """

    gain: float
    eigenfrequency: float
    damping_ratio: float

    @property
    def poles(self) -> tuple[complex, complex]:
        """Both poles, that with the positive imaginary part or the slower one first [rad/s]."""
        root = cmath.sqrt(self.damping_ratio**2 - 1.0)
        return (
            self.eigenfrequency * (-self.damping_ratio + root),
            self.eigenfrequency * (-self.damping_ratio - root),
        )

    def response(self, frequencies: Frequencies) -> Response:
        """Return the frequency response."""
        ratio = 2j * np.pi * np.asarray(frequencies) / self.eigenfrequency
        response = self.gain / (ratio**2 + 2.0 * self.damping_ratio * ratio + 1.0)
        return np.asarray(response, dtype=np.complex128)


def linearise_reduced(parameters: PlantParameters) -> SecondOrderSystem:
    """Return G(s) from load flow [m³/s] to piston velocity [m/s], eqs. (18)-(20).

    Without leakage and with viscous friction alone, as the paper has it; the gain is 1 / mean
    area [1/m²].
    """
    return SecondOrderSystem(
        gain=1.0 / parameters.mean_area,
        eigenfrequency=parameters.omega_c,
        damping_ratio=parameters.zeta,
    )


class CoefficientForm(StrEnum):
    """The form of the flow's partial derivatives."""

    CONSISTENT = "consistent"
    """The derivatives of eq. (14)."""
    PRINTED = "printed"
    """Eqs. (21), (22) as printed: without the factor 1/2 under the root of eq. (14)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowCoefficients:
    """The linear orifice of eq. (23): flow = flow_gain z - flow_pressure_coefficient P_L.

    Attributes:
        flow_gain: C_q, by the orifice state [m²/s].
        flow_pressure_coefficient: C_qp, by the load pressure [m³/(s Pa)].
    """

    flow_gain: float
    flow_pressure_coefficient: float


def linearise_orifice(
    parameters: PlantParameters,
    *,
    orifice_state: float,
    load_pressure: float,
    form: CoefficientForm = CoefficientForm.CONSISTENT,
) -> FlowCoefficients:
    """Return the partial derivatives of the load flow, eqs. (21), (22).

    Those of Q_L = z K sqrt((P_S - P_L) / 2), eq. (14): C_q = K sqrt((P_S - P_L) / 2) and
    C_qp = K z / (2 sqrt(2 (P_S - P_L))). For negative z they are those of the mirrored point.

    Args:
        parameters: of the plant; P_S counts from P_T.
        orifice_state: z [m].
        load_pressure: P_L [Pa], below the supply pressure.
        form: consistent, or as printed.

    Raises:
        ParameterError: the operating point lies beyond the valve's opening or its supply.
    """
    if not abs(orifice_state) <= parameters.alpha:
        raise ParameterError(
            f"orifice state {orifice_state:g} m: the valve opens to {parameters.alpha:g} m"
        )
    supply = parameters.P_S - parameters.P_T
    drop = supply - math.copysign(1.0, orifice_state) * load_pressure
    if not 0.0 < drop <= 2.0 * supply:
        raise ParameterError(
            f"load pressure {load_pressure:g} Pa: must be below the supply's {supply:g} Pa, "
            "at which no flow is left to linearise"
        )
    share = 1.0 if form is CoefficientForm.PRINTED else 0.5
    flow_gain = parameters.K * math.sqrt(share * drop)
    return FlowCoefficients(
        flow_gain=flow_gain, flow_pressure_coefficient=abs(orifice_state) * flow_gain / (2.0 * drop)
    )


def linearise_with_valve(
    parameters: PlantParameters,
    *,
    orifice_state: float,
    load_pressure: float,
    form: CoefficientForm = CoefficientForm.CONSISTENT,
) -> SecondOrderSystem:
    """Return G(s) from orifice state [m] to piston velocity [m/s], eq. (24).

    The leakage C_L takes the same path as C_qp and is counted with it. With both, c in sum,
    C_q G / (1 + c (m s + sigma) G / A) with A the mean area is again of second order: its
    denominator is that of eq. (18) plus c (m s + sigma) / A².

    Args:
        parameters: of the plant.
        orifice_state: z [m].
        load_pressure: P_L [Pa].
        form: of the flow coefficients.
    """
    flow = linearise_orifice(
        parameters, orifice_state=orifice_state, load_pressure=load_pressure, form=form
    )
    plain = linearise_reduced(parameters)
    feedback = (flow.flow_pressure_coefficient + parameters.C_L) * plain.gain**2
    stiffening = 1.0 + feedback * parameters.sigma
    slope = 2.0 * plain.damping_ratio / plain.eigenfrequency + feedback * parameters.m
    return SecondOrderSystem(
        gain=flow.flow_gain * plain.gain / stiffening,
        eigenfrequency=plain.eigenfrequency * math.sqrt(stiffening),
        damping_ratio=0.5 * slope * plain.eigenfrequency / math.sqrt(stiffening),
    )


# The full-order model, linearised about any operating point: Jacobian, poles, zeros.
#
# States are v, P_A, P_B, nu, nu_dot: the five that the paper counts. The position is their
# integral: in a steady motion the chambers' net flows are zero, so to first order neither the
# volumes nor x act back.

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
        [[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, opening, 0.0]]
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
