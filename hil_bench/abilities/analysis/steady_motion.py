"""Steady motions of the full-order model in closed form, without leakage and options.

In a steady motion the velocity, both pressures and the spool stand still while the piston moves.
With z K = g, eqs. (5), (6), (8), (9), (12) then give for an extending piston

    P_A = P_S - (A_A v / g)²,   P_B = P_T + (A_B v / g)²,
    P_S A_A - P_T A_B - f(v) - F_L = (A_A³ + A_B³) (v / g)²,

and for a retracting one the same with A and B exchanged and the load turned round.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    SpringLoad,
    runge_kutta,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    Constants,
    pack,
    pack_extended,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state
from hil_bench.plants.hydraulic_cylinder.model.validation import require_finite

# Errors that an analysis raises.


class OperatingPointError(ParameterError):
    """There is no such operating point; the message says what stands against it."""


class NyquistError(ParameterError):
    """An excitation holds frequencies that its sampling cannot carry."""


# The right-hand side of the full-order model, as the plant's solver for references takes it.

Rates = npt.NDArray[np.float64]
"""Time derivatives of x, v, P_A, P_B, nu, nu_dot."""

_ANY_STEP = 1e-4
"""A right-hand side has no step, but a row of constants a place for one [s]."""


def state_rates(
    parameters: PlantParameters, options: PlantOptions, state: PlantState, plant_input: PlantInput
) -> Rates:
    """Return the time derivatives of the six states [m/s, m/s², Pa/s, Pa/s, m/s, m/s²].

    The loads of the options are those of time 0, bristles are straight, the supply is at P_S.
    """
    row = make_row(pack_extended(parameters, options, _ANY_STEP))
    # The kernel adds the springs, which follow the position.
    loads = [load for load in options.loads if not isinstance(load, SpringLoad)]
    load = plant_input.F_L + math.fsum(load.force_at(state.x, 0.0) for load in loads)
    states = (*state, 0.0, parameters.P_S)
    rates = runge_kutta.state_rates(states, plant_input.u, load, unpack(row), unpack_extended(row))
    return np.array(rates[:6], dtype=np.float64)


def orifice_state_at(
    parameters: PlantParameters, options: PlantOptions, spool_position: float
) -> float:
    """Return the orifice state z [m] at a spool position [m], eq. (2)."""
    return float(orifice_state(spool_position, _constants(parameters, options)[2]))


def friction_at(parameters: PlantParameters, options: PlantOptions, velocity: float) -> float:
    """Return the friction force [N] at a constant piston velocity [m/s], eq. (13)."""
    return float(friction_force(velocity, _constants(parameters, options)[6]))


def _constants(parameters: PlantParameters, options: PlantOptions) -> Constants:
    return unpack(make_row(pack(parameters, options, _ANY_STEP)))


_BISECTIONS = 40  # a start for Newton's method needs no more


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingPoint:
    """A steady motion or a rest of the full-order model.

    Attributes:
        position: of the piston, x [m]; it moves on where the velocity is not zero.
        velocity: of the piston [m/s].
        pressure_a: in chamber A [Pa].
        pressure_b: in chamber B [Pa].
        spool_position: nu, which is also the set-point u [m].
        orifice_state: z [m].
        load: F_L [N].
    """

    position: float
    velocity: float
    pressure_a: float
    pressure_b: float
    spool_position: float
    orifice_state: float
    load: float

    @property
    def state(self) -> PlantState:
        """The plant's state there."""
        return PlantState(
            x=self.position,
            v=self.velocity,
            P_A=self.pressure_a,
            P_B=self.pressure_b,
            nu=self.spool_position,
            nu_dot=0.0,
        )

    @property
    def plant_input(self) -> PlantInput:
        """The plant's input there."""
        return PlantInput(u=self.spool_position, F_L=self.load)

    @property
    def load_pressure(self) -> float:
        """P_L = P_A - P_B [Pa]."""
        return self.pressure_a - self.pressure_b


@dataclass(frozen=True, slots=True, kw_only=True)
class _Direction:
    """One direction of motion, as if the piston extended.

    Attributes:
        sign: of the velocity.
        driving_area: of the chamber that the supply fills [m²].
        driven_area: of the chamber that empties [m²].
        alpha: orifice state at which the valve is fully open [m].
        beta: dead-zone [m].
        drive: force that the supply can hold against, before friction [N].
    """

    sign: float
    driving_area: float
    driven_area: float
    alpha: float
    beta: float
    drive: float

    @property
    def cubes(self) -> float:
        return self.driving_area**3 + self.driven_area**3


def _direction(
    parameters: PlantParameters, options: PlantOptions, sign: float, load: float
) -> _Direction:
    alpha, beta = opening_limits(parameters, options, sign)
    areas = (parameters.A_A, parameters.A_B)
    driving, driven = areas if sign > 0.0 else areas[::-1]
    return _Direction(
        sign=sign,
        driving_area=driving,
        driven_area=driven,
        alpha=alpha,
        beta=beta,
        drive=parameters.P_S * driving - parameters.P_T * driven - sign * load,
    )


def opening_limits(
    parameters: PlantParameters, options: PlantOptions, sign: float
) -> tuple[float, float]:
    """Return saturation alpha and dead-zone beta of one direction of the spool, eq. (2) [m]."""
    alpha, beta = parameters.alpha, parameters.beta
    if sign < 0.0:
        alpha = alpha if options.alpha_negative is None else options.alpha_negative
        beta = beta if options.beta_negative is None else options.beta_negative
    return alpha, beta


def motion_at_velocity(
    parameters: PlantParameters,
    options: PlantOptions,
    position: float,
    velocity: float,
    load: float,
) -> OperatingPoint | None:
    """Return the steady motion at a velocity [m/s]; None where the piston rests.

    Raises:
        OperatingPointError: the supply's force or the valve's opening does not reach.
    """
    if velocity == 0.0:
        return None
    way = _direction(parameters, options, math.copysign(1.0, velocity), load)
    speed = abs(velocity)
    left = way.drive - way.sign * friction_at(parameters, options, velocity)
    if left <= 0.0:
        raise OperatingPointError(
            f"no steady motion at {velocity:g} m/s: load and friction exceed the supply's force "
            f"by {-left:g} N"
        )
    opening = speed / parameters.K * math.sqrt(way.cubes / left)
    if opening > way.alpha:
        raise OperatingPointError(
            f"no steady motion at {velocity:g} m/s: it needs an orifice of {opening * 1e3:.4g} mm, "
            f"and the valve opens to {way.alpha * 1e3:g} mm"
        )
    return _moving(parameters, way, position, speed, opening, opening + way.beta, load)


def motion_at_spool_position(
    parameters: PlantParameters,
    options: PlantOptions,
    position: float,
    spool_position: float,
    load: float,
) -> OperatingPoint | None:
    """Return the steady motion at a spool position [m]; None where the valve is closed.

    Raises:
        OperatingPointError: the load pushes the piston back.
    """
    opening = abs(orifice_state_at(parameters, options, spool_position))
    if opening == 0.0:
        return None
    way = _direction(parameters, options, math.copysign(1.0, spool_position), load)
    if way.drive <= 0.0:
        raise OperatingPointError(
            f"no steady motion at a spool position of {spool_position * 1e3:g} mm: the load "
            f"exceeds the supply's force by {-way.drive:g} N and pushes the piston back"
        )
    resistance = way.cubes / (opening * parameters.K) ** 2
    low, high = 0.0, math.sqrt(way.drive / resistance)
    for _ in range(_BISECTIONS):
        speed = 0.5 * (low + high)
        friction = way.sign * friction_at(parameters, options, way.sign * speed)
        low, high = (speed, high) if friction + resistance * speed**2 < way.drive else (low, speed)
    return _moving(parameters, way, position, high, opening, abs(spool_position), load)


def _moving(
    parameters: PlantParameters,
    way: _Direction,
    position: float,
    speed: float,
    opening: float,
    spool: float,
    load: float,
) -> OperatingPoint:
    per_gain = (speed / (opening * parameters.K)) ** 2
    driving = parameters.P_S - way.driving_area**2 * per_gain
    driven = parameters.P_T + way.driven_area**2 * per_gain
    a, b = (driving, driven) if way.sign > 0.0 else (driven, driving)
    return OperatingPoint(
        position=position,
        velocity=way.sign * speed,
        pressure_a=a,
        pressure_b=b,
        spool_position=way.sign * spool,
        orifice_state=way.sign * opening,
        load=load,
    )


def rest(
    parameters: PlantParameters,
    position: float,
    spool_position: float,
    load: float,
    mean_pressure: float | None,
) -> OperatingPoint:
    """Return the rest with a closed valve and a mean pressure [Pa], P_A A_A - P_B A_B = F_L."""
    mean = 0.5 * (parameters.P_S + parameters.P_T) if mean_pressure is None else mean_pressure
    require_finite("mean_pressure", mean, "Pa")
    half = 0.5 * load
    return OperatingPoint(
        position=position,
        velocity=0.0,
        pressure_a=(mean * parameters.A_B + half) / parameters.mean_area,
        pressure_b=(mean * parameters.A_A - half) / parameters.mean_area,
        spool_position=spool_position,
        orifice_state=0.0,
        load=load,
    )
