"""The steady motion of a cylinder under a constant opening: speed, pressures and flow."""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.constants import (
    edge_constants,
    land_constants,
)
from hil_bench.plants.hydraulic_cylinder.model.extensions import Cushion, MeteringLands, SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import edge_openings
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantState, balanced_state, held_state
from hil_bench.plants.hydraulic_cylinder.model.waves import line_drop

_SHUT = 1e-9  # share of its opening at which a counterbalance valve is as good as shut


class SteadyMotion(NamedTuple):
    """A motion in which nothing changes but the position.

    Attributes:
        speed: of the piston, without its sign; 0 where the load holds it [m/s].
        P_A: pressure in chamber A [Pa].
        P_B: pressure in chamber B [Pa].
        supply_flow: what the valve draws [m³/s].
        is_pump_limited: whether the pump gives less than the valve would draw.
        is_compensated: whether the margin of compensator or load-sensing pump holds the flow.
        is_cavitating: whether the load runs ahead of the oil.
    """

    speed: float
    P_A: float
    P_B: float
    supply_flow: float
    is_pump_limited: bool
    is_compensated: bool
    is_cavitating: bool


def steady_motion(
    parameters: PlantParameters,
    options: PlantOptions,
    *,
    extends: bool,
    z: float | None = None,
    load: float | None = None,
    cushioned: bool = False,
) -> SteadyMotion:
    """Return the steady motion in one direction, without leakage.

    With the speed v, the fed area A_1 and the other A_2 the drops over the edges are
    (A_1 v / (K z))² and (A_2 v / (K z))² (Ruderman 2017 eqs. (5), (6)), so the forces balance where

        P_S A_1 - P_T A_2 - F - f(v) = v² (A_1³ + A_2³) / (K z)²,

    with a K of its own for each edge where the lands differ. Where a load would pull the piston
    faster than oil follows, the fed chamber cavitates, and the edge that drains holds the load:

        P_floor A_1 - P_T A_2 - F - f(v) = v² A_2³ / (K z)².

    A pressure compensator, or a load-sensing pump, leaves its margin to the edge that feeds, so v
    is at most K z sqrt(margin) / A_1. A counterbalance valve is in series with the edge that
    drains, as far open as the pressures of the motion have it; so is the throttle of a cushion.

    Args:
        parameters: of the plant.
        options: of the plant; a supply unit holds its relief pressure as far as its pump can.
        extends: which direction.
        z: orifice state [m]; None for the wide open valve.
        load: against extension [N]; None for that of the options in mid-stroke.
        cushioned: whether the piston is in the cushion at its end of the stroke, if there is one.
    """
    feeding, draining = _conductances(parameters, options, z, extends=extends)
    if cushioned:
        cushion = options.cushion_b if extends else options.cushion_a
        draining = _throttle(parameters, draining, cushion)
    force = options.load_at(0.0) if load is None else load
    valve = options.counterbalance
    if valve is None or not (valve.in_line_b if extends else valve.in_line_a):
        return _move(parameters, options, feeding, draining, force, extends=extends)

    def behind_valve(share: float) -> SteadyMotion:
        own = share * valve.conductance
        drain = 1.0 / math.hypot(1.0 / draining, 1.0 / own)
        return _move(parameters, options, feeding, drain, force, extends=extends)

    low, high = _SHUT, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        motion = behind_valve(middle)
        pressure, pilot = (motion.P_B, motion.P_A) if extends else (motion.P_A, motion.P_B)
        target = (pressure + valve.pilot_ratio * pilot - valve.setting) / valve.span
        if target > middle:
            low = middle
        else:
            high = middle
    return behind_valve(high)


def state_of_rest(parameters: PlantParameters, options: PlantOptions, x: float) -> PlantState:
    """Return the state in which a bench begins at a position [m], under the loads of time 0.

    The mean of the pressures is that of supply and tank. Where the load takes more than that, its
    chamber holds it behind the shut valve, and the other one is at the tank.
    """
    load, valve = options.load_at(x), options.counterbalance
    if valve is None:
        state = balanced_state(parameters, x=x, F_L=load)
        if min(state.P_A, state.P_B) >= parameters.P_T:
            return state
        return held_state(parameters, holds_a=load > 0.0, x=x, F_L=load)
    holds_a = valve.in_line_a and not (valve.in_line_b and load < 0.0)
    return held_state(parameters, holds_a=holds_a, x=x, F_L=load)


def _move(
    parameters: PlantParameters,
    options: PlantOptions,
    feeding: float,
    draining: float,
    force: float,
    *,
    extends: bool,
) -> SteadyMotion:
    """Return the steady motion between two edges.

    Args:
        parameters: of the plant.
        options: of the plant.
        feeding: K z of the edge that feeds [m³/(s sqrt(Pa))].
        draining: the same of what drains.
        force: load against extension [N].
        extends: which direction.
    """
    p, unit = parameters, options.supply
    P_S = p.P_S if unit is None else unit.relief_pressure
    fed, other, against = (p.A_A, p.A_B, force) if extends else (p.A_B, p.A_A, -force)
    drive = P_S * fed - p.P_T * other - against
    inlet, outlet = (
        (options.line_a, options.line_b) if extends else (options.line_b, options.line_a)
    )

    def lost(speed: float, *, fills: bool = True) -> float:
        behind = line_drop(outlet, p.rho, other * speed) * other
        if not fills:
            return behind
        before = line_drop(inlet, p.rho, fed * speed) + _filter_drop(unit, fed * speed)
        return behind + before * fed

    speed = _balance(parameters, drive, fed**3 / feeding**2 + other**3 / draining**2, lost)
    held = _held_flow(options, feeding)
    is_compensated = speed * fed > held
    speed = min(speed, held / fed)
    pump = math.inf if unit is None else unit.pump_flow
    is_limited = speed * fed > pump
    speed = min(speed, pump / fed)
    P_2 = p.P_T + (other * speed / draining) ** 2 + line_drop(outlet, p.rho, other * speed)
    P_1 = (P_2 * other + against + _friction(p, speed)) / fed if speed else P_S
    flow, floor = speed * fed, options.cavitation_floor
    is_cavitating = floor is not None and P_1 < floor
    if floor is not None and is_cavitating:
        drive = floor * fed - p.P_T * other - against
        falls = partial(lost, fills=False)
        speed, P_1 = _balance(parameters, drive, other**3 / draining**2, falls), floor
        P_2 = p.P_T + (other * speed / draining) ** 2 + line_drop(outlet, p.rho, other * speed)
        flow = min(feeding * math.sqrt(P_S - floor), held, pump)
    P_A, P_B = (P_1, P_2) if extends else (P_2, P_1)
    return SteadyMotion(speed, P_A, P_B, flow, is_limited, is_compensated, is_cavitating)


def _held_flow(options: PlantOptions, feeding: float) -> float:
    """Return the flow at which compensator or load-sensing pump hold the feeding edge [m³/s].

    The pump senses its own port: what drops over its filter is lost to the edge.

    Args:
        options: of the plant.
        feeding: K z of the edge [m³/(s sqrt(Pa))].
    """
    margin, unit = options.compensator_margin, options.supply
    held = math.inf if margin is None else feeding * math.sqrt(margin)
    if unit is None or unit.variable is None or not unit.variable.senses_load:
        return held
    margin = unit.variable.margin
    if unit.filter is None:
        return min(held, feeding * math.sqrt(margin))
    R = unit.filter.resistance
    through = 2.0 * margin / (R + math.sqrt(R * R + 4.0 * margin / feeding**2))
    past = feeding * math.sqrt(max(margin - unit.filter.bypass, 0.0))
    return min(held, max(through, past))


def _filter_drop(unit: SupplyUnit | None, flow: float) -> float:
    return 0.0 if unit is None or unit.filter is None else unit.filter.drop(flow)


def _conductances(
    parameters: PlantParameters, options: PlantOptions, z: float | None, *, extends: bool
) -> tuple[float, float]:
    """Return K z of the edge that feeds and of the one that drains [m³/(s sqrt(Pa))]."""
    if options.has_edges:
        edges = edge_constants(parameters, options)
        if z is None:
            nu = edges[6] if extends else edges[7]
        else:
            beta = parameters.beta if extends else options.beta_negative
            nu = z + (parameters.beta if beta is None else beta)
        P_A, A_T, P_B, B_T = edge_openings(
            nu if extends else -nu, edges, land_constants(options.lands)
        )
        fed, drained = (P_A, B_T) if extends else (P_B, A_T)
        return parameters.K * fed, parameters.K * drained
    negative = options.alpha_negative
    alpha = parameters.alpha if extends or negative is None else negative
    lands = MeteringLands() if options.lands is None else options.lands
    full = parameters.K * alpha * lands.bend(1.0 if z is None else z / alpha)
    feeding, draining = lands.gains(extends=extends)
    return full * feeding, full * draining


def _throttle(parameters: PlantParameters, conductance: float, cushion: Cushion | None) -> float:
    """Return the conductance of an edge behind a cushion's throttle [m³/(s sqrt(Pa))]."""
    if cushion is None:
        return conductance
    own = parameters.K * cushion.orifice_area / parameters.w
    return 1.0 / math.hypot(1.0 / conductance, 1.0 / own)


def _friction(parameters: PlantParameters, speed: float) -> float:
    """Return the friction of eq. (13) [N] at a speed above 0 [m/s], with the true sign."""
    p = parameters
    stribeck = (p.F_s - p.F_c) * math.exp(-((speed / p.chi) ** p.delta))
    return p.F_c + stribeck + p.sigma * speed


def _balance(
    parameters: PlantParameters, drive: float, resistance: float, lost: Callable[[float], float]
) -> float:
    """Return the largest speed at which a force drives friction, edges and lines [m/s]; 0 for none.

    Args:
        parameters: of the plant.
        drive: the force [N].
        resistance: of the edges, force over speed² [N s²/m²].
        lost: force that the lines take at a speed [N].
    """
    if drive <= parameters.F_c:
        return 0.0
    low, high = 0.0, math.sqrt(drive / resistance)
    for _ in range(200):
        middle = 0.5 * (low + high)
        if drive - _friction(parameters, middle) - lost(middle) > resistance * middle * middle:
            low = middle
        else:
            high = middle
    return low
