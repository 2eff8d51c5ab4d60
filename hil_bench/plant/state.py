"""What enters the plant, what it remembers and what it shows."""

import math
from typing import NamedTuple

from hil_bench.errors import ParameterError
from hil_bench.plant.options import PlantOptions
from hil_bench.plant.parameters import PlantParameters
from hil_bench.plant.validation import require_finite

_HARDEST = 10.0


class PlantState(NamedTuple):
    """The six states of the full-order model, and what is void where a chamber cavitates.

    Attributes:
        x: piston position from mid-stroke [m].
        v: piston velocity [m/s].
        P_A: pressure in chamber A [Pa].
        P_B: pressure in chamber B [Pa].
        nu: spool position [m].
        nu_dot: spool velocity [m/s].
        V_CA: volume of the cavity in chamber A, 0 above the cavitation floor [m³].
        V_CB: volume of the cavity in chamber B, 0 above the cavitation floor [m³].
    """

    x: float
    v: float
    P_A: float
    P_B: float
    nu: float
    nu_dot: float
    V_CA: float = 0.0
    V_CB: float = 0.0


class PlantInput(NamedTuple):
    """What acts on the plant during a step.

    Attributes:
        u: spool set-point [m].
        F_L: external load, positive against positive motion, eq. (12) [N].
    """

    u: float
    F_L: float = 0.0


class PlantOutput(NamedTuple):
    """What can be seen of the plant.

    Attributes:
        x: piston position from mid-stroke [m].
        v: piston velocity [m/s].
        P_A: pressure in chamber A [Pa].
        P_B: pressure in chamber B [Pa].
        nu: spool position [m].
        z: orifice state, eq. (4) [m].
        Q_A: flow through port A into the cylinder, eq. (5) [m³/s].
        Q_B: flow through port B into the cylinder, eq. (6) [m³/s].
    """

    x: float
    v: float
    P_A: float
    P_B: float
    nu: float
    z: float
    Q_A: float
    Q_B: float


def require_finite_state(state: PlantState) -> None:
    """Refuse a state that is not finite; the message names the first symbol that is not."""
    units = ("m", "m/s", "Pa", "Pa", "m", "m/s", "m³", "m³")
    for symbol, value, unit in zip(PlantState._fields, state, units, strict=True):
        require_finite(symbol, value, unit)


def check_cavity(
    chamber: str, cavity: float, volume: float, pressure: float, floor: float | None
) -> None:
    """Refuse a cavity that its chamber cannot have.

    Args:
        chamber: "A" or "B".
        cavity: in it [m³].
        volume: of the chamber [m³].
        pressure: in the chamber [Pa].
        floor: cavitation floor [Pa], None for no floor.

    Raises:
        ParameterError: for a cavity that is negative, as large as the chamber or above the floor.
    """
    named = f"V_C{chamber} = {cavity:g} m³"
    if not 0.0 <= cavity < volume:
        raise ParameterError(
            f"{named}: must be 0 or greater, and smaller than the chamber, {volume:g} m³"
        )
    is_above = floor is None or not math.isclose(pressure, floor, rel_tol=1e-9, abs_tol=1e-3)
    if cavity > 0.0 and is_above:
        limit = "there is no cavitation floor" if floor is None else f"the floor is at {floor:g} Pa"
        raise ParameterError(f"{named}: must be 0 at P_{chamber} = {pressure:g} Pa, for {limit}")


def check_position(x: float, parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse a position to which no pressure and no impact takes the piston.

    Args:
        x: piston position [m].
        parameters: of the plant.
        options: of the plant; without an end stop every position is right.

    Raises:
        ParameterError: for a piston deeper in a stop than `_HARDEST` times P_S A presses it.
    """
    stop = options.end_stop
    if stop is None:
        return
    depth = _HARDEST * parameters.P_S * max(parameters.A_A, parameters.A_B) / stop.stiffness
    if abs(x) > parameters.h + depth:
        raise ParameterError(f"x = {x:g} m: must lie between the end stops at +-{parameters.h:g} m")


def balanced_state(
    parameters: PlantParameters,
    *,
    x: float = 0.0,
    mean_pressure: float | None = None,
    F_L: float = 0.0,
) -> PlantState:
    """Return the state of rest in which the pressures hold the piston: P_A A_A = P_B A_B + F_L.

    Args:
        parameters: of the plant.
        x: piston position [m].
        mean_pressure: mean of P_A and P_B [Pa]; None for the middle of supply and tank.
        F_L: external load [N].
    """
    mean = 0.5 * (parameters.P_S + parameters.P_T) if mean_pressure is None else mean_pressure
    require_finite("mean_pressure", mean, "Pa")
    require_finite("x", x, "m")
    require_finite("F_L", F_L, "N")
    held = 0.5 * F_L / parameters.mean_area
    P_A = mean * parameters.A_B / parameters.mean_area + held
    P_B = mean * parameters.A_A / parameters.mean_area - held
    return PlantState(x=x, v=0.0, P_A=P_A, P_B=P_B, nu=0.0, nu_dot=0.0)
