"""The reduced model, linearised: eqs. (18)-(20) from flow to velocity, (21)-(24) with the valve.

Ruderman 2017, section IV-A. Symbols in words: eigenfrequency omega_c, damping ratio zeta, flow gain
C_q, flow-pressure coefficient C_qp, orifice state z, load pressure P_L.
"""

import cmath
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

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
