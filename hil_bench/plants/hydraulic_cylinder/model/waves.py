"""Lines by the method of characteristics: what happens at an end arrives at the other after L / c.

With the flow q into the line at an end, its pressure is

    p = c + (Z + R / 2) q,   c(t) = c'(t - T) + 2 Z q'(t - T)

where the dash is the other end, T = L / c the wave time, Z = rho c / A the impedance and R the
resistance of the whole line, half of it at each end (P. Krus, K. Weddfelt, J.-O. Palmberg, *Fast
pipeline models for simulation of hydraulic systems*, ASME Journal of Dynamic Systems, Measurement
and Control 116, 1994; D. M. Auslander, *Distributed system simulation with bilateral delay-line
models*, ASME Journal of Basic Engineering 90, 1968). Without friction that solves the wave equation
exactly. Nothing at one end acts on the other within a step, so valve and cylinder are apart.

A wave is the mean over a step, and the wave time a whole number n of steps. Z is n dt E / V, so the
line's compliance V / E is exact, and the oil that it holds is dt / (2 Z) times the sum of all waves
under way: what flows in stays in, to rounding.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    Edge,
    OrificeConstants,
    flow_from_supply,
    flow_to_tank,
)
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

# A line between valve and cylinder, as long as its waves need time.


MOST_STEPS = 65_536
"""Steps that a wave may take through a line: 3 s at 50 us."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A hose or a pipe whose waves need time.

    Attributes:
        length: of the line [m].
        inner: its inner diameter [m].
        bulk_modulus: of the oil in it with the give of its wall [Pa].
        viscosity: kinematic, of the oil [m²/s].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    length: float
    inner: float
    bulk_modulus: float
    viscosity: float = 46e-6

    def __post_init__(self) -> None:
        for name, unit in (
            ("length", "m"),
            ("inner", "m"),
            ("bulk_modulus", "Pa"),
            ("viscosity", "m²/s"),
        ):
            require_positive(name, getattr(self, name), unit, "the line")

    @property
    def area(self) -> float:
        """Cross-section [m²]."""
        return 0.25 * math.pi * self.inner * self.inner

    @property
    def volume(self) -> float:
        """Return the volume of the line [m³]."""
        return self.area * self.length

    @property
    def compliance(self) -> float:
        """The compliance of the line, V / E [m³/Pa]."""
        return self.volume / self.bulk_modulus

    def wave_speed(self, density: float) -> float:
        """Return c = sqrt(E / rho) [m/s] for an oil of this density [kg/m³]."""
        return math.sqrt(self.bulk_modulus / density)

    def wave_time(self, density: float) -> float:
        """Return L / c, which a wave takes from end to end [s]."""
        return self.length / self.wave_speed(density)

    def impedance(self, density: float) -> float:
        """Return rho c / area, the pressure of a wave per flow [Pa s/m³]."""
        return density * self.wave_speed(density) / self.area

    def resistance(self, density: float) -> float:
        """Return the pressure drop per laminar flow, 128 rho nu L / (pi d⁴) [Pa s/m³]."""
        return 128.0 * density * self.viscosity * self.length / (math.pi * self.inner**4)

    def steps(self, density: float, dt: float) -> int:
        """Return the whole steps of `dt` [s] that come next to the wave time, at least one."""
        return max(1, round(self.wave_time(density) / dt))


def korteweg(modulus: float, inner: float, wall: float, wall_modulus: float) -> float:
    """Return the bulk modulus of oil in a thin-walled pipe that gives [Pa].

    1 / E = 1 / E_oil + d / (s E_wall): the wall's hoop strain (D. J. Korteweg, Annalen der Physik
    241, 1878; E. B. Wylie and V. L. Streeter, Fluid Transients in Systems, 1993, eq. 1-6).

    Args:
        modulus: of the oil [Pa].
        inner: inner diameter [m].
        wall: its thickness [m].
        wall_modulus: Young's modulus of the wall [Pa].
    """
    return 1.0 / (1.0 / modulus + inner / (wall * wall_modulus))


def check_line(symbol: str, line: Line | None, density: float, dt: float) -> None:
    """Refuse a line through which a wave passes within a step, or in more than `MOST_STEPS`.

    Raises:
        ParameterError: the message names the line by its symbol.
    """
    if line is None:
        return
    time = line.wave_time(density)
    if time < dt:
        raise ParameterError(
            f"{symbol} = {line.length:g} m: a wave passes it in {time * 1e6:.3g} us, within one "
            f"step of {dt * 1e6:g} us; count it as volume, or take a shorter step",
            symbol,
        )
    if time > MOST_STEPS * dt:
        raise ParameterError(
            f"{symbol} = {line.length:g} m: a wave takes {time:.3g} s through it, more than "
            f"{MOST_STEPS} steps of {dt * 1e6:g} us; give a shorter line or a longer step",
            symbol,
        )


LineConstants = tuple[float, float, float, float]
"""(n, Z [Pa s/m³], half of the laminar resistance [Pa s/m³], Reynolds number per flow [s/m³]).

n is 0 without a line.
"""

Side = tuple[float, float, float, float, float]
"""A line in a step: (c at the valve, c at the cylinder [Pa], p over q at both [Pa s/m³], cavity).

The cavity is at the valve's end [m³].
"""

NO_SIDE: Side = (0.0, 0.0, 1.0, 1.0, 0.0)
"""Of a port without a line."""

ValveEnd = tuple[float, float, float, float, float, float]
"""(p [Pa], flow into the line, flow from the supply [m³/s], their slopes by P_S, cavity [m³])."""

LAMINAR, TURBULENT = 2300.0, 4000.0
"""Reynolds numbers up to which flow is laminar, and from which on it is turbulent."""

_BLASIUS = 0.3164
_AT_LAMINAR = 64.0 / LAMINAR
_AT_TURBULENT = _BLASIUS / math.sqrt(math.sqrt(TURBULENT))
_CLOSE = 1e-3  # [Pa], as near as a pressure at the valve's end is found
_ROUNDS = 60

# The lines' part of the row of states, a pair each: where the waves arrive; at the valve's end the
# last pressure and the cavity; the last flows and c at both ends; the pressure to be seen. Then the
# waves.
CURSOR, PRESSURE, CAVITY, AT_VALVE, AT_CYLINDER, WAS_VALVE, WAS_CYLINDER, SHOWN = range(0, 16, 2)
QUEUE = 16


def line_constants(line: Line | None, density: float, dt: float) -> LineConstants:
    """Return the constants of a line, for an oil of a density [kg/m³] and a step [s]."""
    if line is None:
        return 0.0, 1.0, 0.0, 0.0
    n = line.steps(density, dt)
    per_flow = 4.0 / (math.pi * line.inner * line.viscosity)
    return float(n), n * dt / line.compliance, 0.5 * line.resistance(density), per_flow


def require_waves(waves: Sequence[float], size: int) -> None:
    """Refuse what is no part of a row of states for lines of this size.

    Raises:
        ParameterError: it is of other lines, of another step, or not finite.
    """
    if len(waves) != size or not all(map(math.isfinite, waves)):
        raise ParameterError(
            f"waves = {len(waves)} numbers: must be {size} finite ones, of the same lines and step",
            "waves",
        )


@kernel
def friction_ratio(reynolds: float) -> float:
    """Return the pressure drop over that of laminar flow.

    The friction factor is 64 / Re of Hagen and Poiseuille up to 2300, that of Blasius,
    0.3164 / Re^0.25, from 4000 on, and linear in Re between.
    """
    if reynolds <= LAMINAR:
        return 1.0
    if reynolds >= TURBULENT:
        return _BLASIUS / 64.0 * math.sqrt(reynolds * math.sqrt(reynolds))
    share = (reynolds - LAMINAR) / (TURBULENT - LAMINAR)
    return (_AT_LAMINAR + share * (_AT_TURBULENT - _AT_LAMINAR)) * reynolds / 64.0


def line_drop(line: Line | None, density: float, flow: float) -> float:
    """Return the pressure drop [Pa] of a steady flow [m³/s] through a line; 0 without one."""
    if line is None:
        return 0.0
    reynolds = 4.0 * abs(flow) / (math.pi * line.inner * line.viscosity)
    return line.resistance(density) * friction_ratio(reynolds) * flow


@kernel
def end_resistance(flow: float, line: LineConstants) -> float:
    """Return the pressure over c per flow at an end, Z + R / 2 [Pa s/m³].

    Args:
        flow: through that end in the step before [m³/s].
        line: the constants.
    """
    return line[1] + line[2] * friction_ratio(abs(flow) * line[3])


@kernel
def both_edges(
    pressure: float,
    openings: tuple[float, float],
    margin: float,
    orifice: OrificeConstants,
) -> tuple[Edge, Edge]:
    """Return the flows of the edges from the supply and to the tank, with nothing before them.

    Args:
        pressure: at the port [Pa].
        openings: of both edges [m].
        margin: of a pressure compensator [Pa]; infinite for none.
        orifice: the constants.
    """
    return (
        flow_from_supply(openings[0], pressure, 0.0, margin, orifice),
        flow_to_tank(openings[1], pressure, 0.0, orifice),
    )


@kernel
def port_pressure(
    near: float,
    side: Side,
    openings: tuple[float, float],
    margin: float,
    orifice: OrificeConstants,
) -> float:
    """Return the pressure at which the edges pass what the line takes [Pa].

    The flow of the edges falls and that of the line rises with the pressure, so there is one such
    pressure, between the least and the largest of c, P_S and P_T: Newton's method within that
    bracket.

    Args:
        near: a pressure to begin with [Pa].
        side: the line.
        openings: of the edges from the supply and to the tank [m].
        margin: of a pressure compensator [Pa]; infinite for none.
        orifice: the constants.
    """
    c, per_flow = side[0], 1.0 / side[2]
    low = min(c, orifice[1], orifice[2])
    high = max(c, orifice[1], orifice[2])
    p = min(max(near, low), high)
    for _ in range(_ROUNDS):
        supply, tank = both_edges(p, openings, margin, orifice)
        excess = supply[0] + tank[0] - (p - c) * per_flow
        if excess > 0.0:
            low = p
        else:
            high = p
        moved = p + excess / (supply[2] + tank[2] + per_flow)
        if not low <= moved <= high:
            moved = 0.5 * (low + high)
        change = abs(moved - p)
        p = moved
        if change <= _CLOSE:
            break
    return p


@kernel
def valve_end(
    near: float,
    side: Side,
    openings: tuple[float, float],
    margin: float,
    floor: float,
    dt: float,
    orifice: OrificeConstants,
) -> ValveEnd:
    """Return the state at the valve's end of a line over a step.

    At the floor a cavity takes what the line draws and the valve does not give; it closes before
    the pressure rises again (the discrete vapour cavity of E. B. Wylie and V. L. Streeter, Fluid
    Transients in Systems, 1993, chapter 8).

    Args:
        near: a pressure to begin with [Pa].
        side: the line.
        openings: of the edges from the supply and to the tank [m].
        margin: of a pressure compensator [Pa]; infinite for none.
        floor: lowest pressure [Pa].
        dt: step [s].
        orifice: the constants.
    """
    c, resistance, cavity = side[0], side[2], side[4]
    per_flow = 1.0 / resistance
    p = port_pressure(near, side, openings, margin, orifice)
    if p < floor or cavity > 0.0:
        supply, tank = both_edges(floor, openings, margin, orifice)
        flow = (floor - c) * per_flow
        left = cavity + dt * (flow - supply[0] - tank[0])
        if left > 0.0:
            return floor, flow, supply[0], 0.0, 0.0, left
        flow = supply[0] + tank[0] - cavity / dt
        return c + resistance * flow, flow, supply[0], 0.0, 0.0, 0.0
    supply, tank = both_edges(p, openings, margin, orifice)
    whole = per_flow + supply[2] + tank[2]
    slope = supply[2] / whole
    return p, (p - c) * per_flow, supply[0], slope * per_flow, slope * (per_flow + tank[2]), 0.0


@kernel
def cylinder_end(pressure: float, side: Side, resistance: float) -> tuple[float, float, float]:
    """Return the flow from a line into a chamber [m³/s], its secant and its tangent [m³/(s Pa)].

    Oil that leaves the chamber may have to pass a cushion or a counterbalance valve before the
    line: drop = (Z + R / 2) q + (r q)².

    Args:
        pressure: in the chamber [Pa].
        side: the line.
        resistance: root of the drop per flow of what oil that leaves passes [Pa^0.5 s/m³].
    """
    drop, linear = side[1] - pressure, side[3]
    if drop >= 0.0 or resistance == 0.0:
        return drop / linear, 1.0 / linear, 1.0 / linear
    if resistance == math.inf:
        return 0.0, 0.0, 0.0
    root = math.sqrt(linear * linear - 4.0 * drop * resistance * resistance)
    secant = 2.0 / (linear + root)
    return secant * drop, secant, 1.0 / root


@kernel
def arrive(row: Floats, first: int, place: int, queue: int, line: LineConstants) -> Side:
    """Return a line at the start of a step, with the waves that arrive in it.

    Args:
        row: of states.
        first: where the lines' part of it begins.
        place: 0 for A, 1 for B.
        queue: where the waves of this line begin.
        line: the constants.
    """
    if line[0] == 0.0:
        return NO_SIDE
    at = queue + 2 * int(row[first + CURSOR + place])
    return (
        row[at],
        row[at + 1],
        end_resistance(row[first + AT_VALVE + place], line),
        end_resistance(row[first + AT_CYLINDER + place], line),
        row[first + CAVITY + place],
    )


@kernel
def between_steps(row: Floats, first: int, place: int, side: Side) -> Side:
    """Return a line at the end of a step: c is between those of this step and of the next.

    Args:
        row: of states.
        first: where the lines' part of it begins.
        place: 0 for A, 1 for B.
        side: the line at the start of the next step.
    """
    at_valve, at_cylinder = row[first + WAS_VALVE + place], row[first + WAS_CYLINDER + place]
    return 0.5 * (at_valve + side[0]), 0.5 * (at_cylinder + side[1]), side[2], side[3], side[4]


@kernel
def depart(
    row: Floats,
    first: int,
    place: int,
    queue: int,
    flows: tuple[float, float],
    line: LineConstants,
) -> None:
    """Send the waves of a step into a line, in the place of those that have arrived.

    Args:
        row: of states.
        first: where the lines' part of it begins.
        place: 0 for A, 1 for B.
        queue: where the waves of this line begin.
        flows: mean flows into the line at the valve and at the cylinder [m³/s].
        line: the constants.
    """
    if line[0] == 0.0:
        return
    cursor = int(row[first + CURSOR + place])
    at = queue + 2 * cursor
    row[first + WAS_VALVE + place], row[first + WAS_CYLINDER + place] = row[at], row[at + 1]
    to_cylinder = row[at] + 2.0 * line[1] * flows[0]
    row[at] = row[at + 1] + 2.0 * line[1] * flows[1]
    row[at + 1] = to_cylinder
    row[first + AT_VALVE + place], row[first + AT_CYLINDER + place] = flows
    cursor += 1
    row[first + CURSOR + place] = float(cursor) if cursor < int(line[0]) else 0.0
