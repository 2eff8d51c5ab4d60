"""Inputs, states and outputs of the plant, and the row of states that a kernel moves on."""

from typing import NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.constants import (
    SERIES,
    Constants,
    ExtendedConstants,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    OrificeConstants,
    Shares,
    behind,
    cushion_resistances,
    flow_through_edges,
    port_flow,
)
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.spool import (
    OpeningConstants,
    meter_openings,
    orifice_state,
)
from hil_bench.plants.hydraulic_cylinder.model.supply import behind_filter
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


# The row of states that a stepping kernel moves on: how it is read, written back and shown.


Seen = tuple[float, float, float, float, float, float, float, float]
"""The fields of `model.state.PlantOutput`."""

PlainStates = tuple[float, float, float, float, float, float, float, float]
"""The fields of `model.state.PlantState`, which begin each row."""

States = tuple[float, float, float, float, float, float, float, float, float, float]
"""(x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S).

In the row of a plant with extensions the steps since time 0 stand before the last two, and the
point of the load series after them.
"""

PLAIN_EXTRA = 8
"""Place of the extra evaluations in the row of a plant without extensions."""

STEPS, SUPPLY, POINT, EXTRA, INNER, LINES = 8, 10, 11, 12, 13, 16
"""Places in the row of a plant with extensions: steps since time 0, P_S, point of the series,
evaluations beyond one a step; openings of counterbalance valves and the pump's flow; lines."""

NO_VALVES: Shares = (0.0, 0.0)
"""Of the solvers that have no counterbalance valves."""


@kernel
def show(states: PlainStates, opening: OpeningConstants, orifice: OrificeConstants) -> Seen:
    """Return the outputs of a plant in these states."""
    x, v, P_A, P_B, nu, _, _, _ = states
    z = orifice_state(nu, opening)
    return x, v, P_A, P_B, nu, z, port_flow(z, P_A, orifice), port_flow(-z, P_B, orifice)


@kernel
def keep(row: Floats, states: PlainStates, constants: Constants) -> Seen:
    """Write the states of a plant without extensions back, and return what is seen of them."""
    row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7] = states
    return show(states, constants[2], constants[4])


@kernel
def read_states(row: Floats) -> States:
    """Return the states of a plant with extensions."""
    return (
        row[0],
        row[1],
        row[2],
        row[3],
        row[4],
        row[5],
        row[6],
        row[7],
        row[9],
        row[10],
    )


@kernel
def valve_flows(
    x: float,
    nu: float,
    pressures: tuple[float, float],
    shares: Shares,
    orifice: OrificeConstants,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[float, float, float]:
    """Return the flows through A, through B and out of the supply [m³/s].

    Args:
        x: piston position [m].
        nu: spool position [m].
        pressures: P_A and P_B [Pa].
        shares: by which the counterbalance valves are open.
        orifice: the constants, with the present P_S.
        constants: in their groups.
        extension: those of the extensions.
    """
    lands, edges, margin, cushions, valve = extension[5:10]
    if edges[0] == 0.0:
        z = orifice_state(nu, constants[2])
        open_A, open_B = meter_openings(z, constants[2], lands)
        Q_A = port_flow(open_A, pressures[0], orifice)
        Q_B = port_flow(open_B, pressures[1], orifice)
        return Q_A, Q_B, Q_A if z > 0.0 else Q_B
    cushion_A, cushion_B = cushion_resistances(x, constants[5][6], cushions)
    resistances = (
        behind(cushion_A, shares[0], valve[0], valve[5]),
        behind(cushion_B, shares[1], valve[1], valve[5]),
    )
    PA, AT, PB, BT = flow_through_edges(
        nu, pressures, resistances, margin[0], orifice, edges, lands
    )
    return PA[0] + AT[0], PB[0] + BT[0], PA[0] + PB[0]


@kernel
def write_states(row: Floats, states: States, steps: int, point: int) -> None:
    """Write the states of a plant with extensions back, as `keep_extended` takes them."""
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = states
    row[0], row[1], row[2], row[3], row[4], row[5] = x, v, P_A, P_B, nu, nu_dot
    row[6], row[7], row[9], row[10] = V_CA, V_CB, z_f, P_S
    row[STEPS], row[POINT] = row[STEPS] + steps, float(point - SERIES)


@kernel
def keep_extended(
    row: Floats,
    states: States,
    steps: int,
    point: int,
    constants: Constants,
    extension: ExtendedConstants,
) -> Seen:
    """Write the states of a plant with extensions back, and return what is seen of them.

    Args:
        row: takes the states.
        states: of the plant.
        steps: made since they were read.
        point: index of the load series' point in the row of constants.
        constants: in their groups.
        extension: those of the extensions.
    """
    write_states(row, states, steps, point)
    x, v, P_A, P_B, nu, _, _, _, _, P_S = states
    K, _, P_T, transition, signed = constants[4]
    orifice = (K, P_S, P_T, transition, signed)
    z = orifice_state(nu, constants[2])
    shares = (row[INNER], row[INNER + 1])
    Q_A, Q_B, _ = valve_flows(x, nu, (P_A, P_B), shares, orifice, constants, extension)
    return x, v, P_A, P_B, nu, z, Q_A, Q_B


@kernel
def filter_drop(row: Floats, constants: Constants, extension: ExtendedConstants) -> float:
    """Return the drop over the filter of a plant's supply unit [Pa]; arguments as `see_supply`."""
    supply, pump, P_S = extension[4], extension[10], row[SUPPLY]
    pumped = supply[1] if pump[0] == 0.0 else row[INNER + 2]
    given = pumped - pump[2] * (P_S - constants[4][2])
    return behind_filter(P_S, given, supply, extension[11])[1]


@kernel
def see_supply(row: Floats, constants: Floats) -> tuple[float, float]:
    """Return a plant's flow from its supply unit now [m³/s], and the filter's drop [Pa].

    Args:
        row: states of a plant with extensions, without lines.
        constants: as `model.extended_constants.pack_extended` gives them.
    """
    groups, extension = unpack(constants), unpack_extended(constants)
    K, _, P_T, transition, signed = groups[4]
    orifice, shares = (K, row[SUPPLY], P_T, transition, signed), (row[INNER], row[INNER + 1])
    ports = (row[2], row[3])
    _, _, drawn = valve_flows(row[0], row[4], ports, shares, orifice, groups, extension)
    return drawn, filter_drop(row, groups, extension)
