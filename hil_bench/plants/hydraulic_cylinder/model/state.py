"""Inputs, states and outputs of the plant."""

from typing import NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.validation import require_finite


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
    """The inputs of the plant during a step.

    Attributes:
        u: spool set-point [m].
        F_L: external load, positive against positive motion, eq. (12) [N].
    """

    u: float
    F_L: float = 0.0


class PlantOutput(NamedTuple):
    """The visible outputs of the plant.

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


def held_state(
    parameters: PlantParameters, *, holds_a: bool, x: float = 0.0, F_L: float = 0.0
) -> PlantState:
    """Return the state of rest of a load on a counterbalance valve, the other port at the tank.

    Args:
        parameters: of the plant.
        holds_a: whether A carries the load, else B does.
        x: piston position [m].
        F_L: external load [N]; one that the chamber cannot carry leaves both at the tank.
    """
    p = parameters
    fed, other, force = (p.A_A, p.A_B, F_L) if holds_a else (p.A_B, p.A_A, -F_L)
    carried = max((p.P_T * other + force) / fed, p.P_T)
    P_A, P_B = (carried, p.P_T) if holds_a else (p.P_T, carried)
    return PlantState(x=x, v=0.0, P_A=P_A, P_B=P_B, nu=0.0, nu_dot=0.0)
