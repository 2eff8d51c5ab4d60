"""A valve-controlled cylinder written apart from the bench, its equations solved by SciPy.

It has what the bench's plant lacks, or has it in another form, so that an estimate on its records
shows what a model is worth on a machine that is not of its own kind:

- spool: delay, slew limit, stiction, flow force; four overlaps with rounded edges, areas that may
  have two slopes, and the valve body as orifices in series with the lands;
- oil: modulus that rises with pressure, air by the polytropic law, hoses that yield; viscosity and
  density, and so friction, leakage and flow, by temperature;
- lines: a lump of inertia and resistance between two volumes, with the sensor at either end;
- friction: a Stribeck curve for each direction, and a part that grows with the pressures;
- supply: constant, a pump whose pressure sags, or pump, accumulator and relief valve.

All quantities are SI units, pressures are gauge pressures, x = 0 is mid-stroke.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

ATMOSPHERE = 101325.0
GRAVITY = 9.81
ROW = 5e-4  # s between two rows of a run
REST = 0.25  # s of centred valve before and after a stroke
PRESSED = 0.15  # s that a stroke to the stop goes on there
LONGEST = 6.0  # s of a stroke
STUCK = 2e-3  # strokes a second: a spool so slow has stopped
CONTACT = 2e8, 3e4  # N/m, N s/m of the end caps

S, DS, AV, QA, PA, BV, QB, PB, X, V, PS = range(11)
SCALES = np.array([1.0, 100.0, 1e6, 1e-4, 1e6, 1e6, 1e-4, 1e6, 0.1, 0.1, 1e6])


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine; the defaults are a plain one, of the bench's kind as near as may be."""

    # cylinder
    area_a: float = 1.9635e-3
    area_b: float = 1.3478e-3
    stroke: float = 0.25
    mass: float = 120.0
    gravity_share: float = 0.0  # of the weight along the rod: 1 lifts when it extends
    dead_a: float = 60e-6
    dead_b: float = 60e-6
    leakage: float = 0.0
    outer_leakage: float = 0.0
    # friction, extending and retracting
    coulomb: tuple[float, float] = (300.0, 300.0)
    static: tuple[float, float] = (450.0, 450.0)
    viscous: tuple[float, float] = (900.0, 900.0)
    stribeck: tuple[float, float] = (0.02, 0.02)
    seal_share: float = 0.0  # N per Pa of both pressures together
    # valve; lengths are shares of the spool's stroke, flows are at full opening
    conductance: float = 2.0e-7  # m3/s per sqrt(Pa) of an edge
    overlaps: tuple[float, float, float, float] = (0.02, 0.02, 0.02, 0.02)  # PA, AT, PB, BT
    gains: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    rounding: float = 0.004
    knee: float = 0.0  # opening below which an edge has half its slope
    body: float = math.inf  # conductance of the body's channels of a port
    laminar: float = 2e4
    null_shift: float = 0.0
    omega: float = 500.0
    damping: float = 0.8
    delay: float = 0.0
    slew: float = math.inf  # strokes a second
    stiction: float = 0.0
    flow_force: float = 0.0  # share of the stroke at full opening and supply pressure
    # oil
    modulus: float = 1.4e9
    modulus_slope: float = 0.0  # Pa per Pa
    air: float = 0.001
    hose_modulus: float = math.inf
    temperature: float = 40.0
    # lines
    line_length: float = 0.0
    line_inner: float = 10e-3
    # supply
    supply: float = 140e5
    tank: float = 2e5
    supply_kind: str = "constant"  # "sagging", "accumulator"
    sag: float = 0.0  # Pa per m3/s
    sag_time: float = 0.05
    pump: float = 5e-4
    gas: float = 1e-3  # m3 at 0.6 of the supply pressure
    density: float = 860.0

    @property
    def half(self) -> float:
        return 0.5 * self.stroke


class Run(NamedTuple):
    """What a stroke was: rows of `ROW`, the command as it was set, and where the states ended."""

    time: np.ndarray
    command: np.ndarray
    x: np.ndarray
    v: np.ndarray
    pressure_a: np.ndarray  # where the sensors sit: at the valve where there are lines
    pressure_b: np.ndarray
    supply: np.ndarray
    spool: np.ndarray
    end: np.ndarray


def viscosity_factor(temperature: float) -> float:
    """Viscosity over that at 40 °C, of HLP 46 between 20 and 70 °C to some per cent."""
    return math.exp(-0.036 * (temperature - 40.0))


def modulus_at(machine: Machine, pressure: float) -> float:
    """Effective modulus of oil, air and hose."""
    absolute = max(pressure + ATMOSPHERE, 5e3)
    oil = machine.modulus + machine.modulus_slope * max(pressure, 0.0)
    ratio = machine.air / (1.0 - machine.air) * (ATMOSPHERE / absolute) ** (1.0 / 1.3)
    mixed = (1.0 + ratio) / (1.0 / oil + ratio / (1.3 * absolute))
    return 1.0 / (1.0 / mixed + 1.0 / machine.hose_modulus)


def friction_at(machine: Machine, v: float, pressures: float, thickness: float) -> float:
    """Friction that brakes a velocity v."""
    side = 0 if v >= 0.0 else 1
    coulomb, static = machine.coulomb[side], machine.static[side]
    curve = coulomb + (static - coulomb) * math.exp(-abs(v) / machine.stribeck[side])
    curve += machine.seal_share * max(pressures, 0.0)
    return curve * math.tanh(v / 1.5e-3) + thickness * machine.viscous[side] * v


def edge_flow(machine: Machine, opening: float, gain: float, drop: float) -> float:
    """Flow over an edge and the body's channel behind it."""
    c = machine.rounding
    area = 0.5 * (opening + math.sqrt(opening * opening + c * c))
    if machine.knee:
        area -= 0.5 * min(area, machine.knee)
    land = machine.conductance * gain * area
    whole = land / math.sqrt(1.0 + (land / machine.body) ** 2)
    return whole * drop / (drop * drop + machine.laminar * machine.laminar) ** 0.25


def edge_flows(m: Machine, at: float, ps: float, pa: float, pb: float):
    """Flows over P-A, A-T, P-B and B-T, and what they push the spool back by, in strokes."""
    opened = (at - m.overlaps[0], -at - m.overlaps[1], -at - m.overlaps[2], at - m.overlaps[3])
    drops = (ps - pa, pa - m.tank, ps - pb, pb - m.tank)
    flows = [edge_flow(m, *one) for one in zip(opened, m.gains, drops, strict=True)]
    if not m.flow_force:
        return flows, 0.0
    pushes = [max(one, 0.0) * drop for one, drop in zip(opened, drops, strict=True)]
    closing = pushes[0] + pushes[3] - pushes[1] - pushes[2]
    return flows, m.flow_force * closing / m.supply


def contact(m: Machine, x: float, v: float) -> float:
    """Force of the end caps on the piston."""
    if x > m.half:
        return -max(CONTACT[0] * (x - m.half) + CONTACT[1] * v, 0.0)
    if x < -m.half:
        return -min(CONTACT[0] * (x + m.half) + CONTACT[1] * v, 0.0)
    return 0.0


def supply_slope(m: Machine, ps: float, drawn: float) -> float:
    """dP_S/dt where the valve draws a flow."""
    if m.supply_kind == "constant":
        return 0.0
    if m.supply_kind == "sagging":
        return (m.supply - m.sag * drawn - ps) / m.sag_time
    gas = m.gas * 0.6 * m.supply / max(ps, 0.3 * m.supply)
    relief = max(ps - m.supply, 0.0) * m.pump / 8e5
    return 1.3 * max(ps, 1e5) / gas * (m.pump - relief - drawn)


def line_slopes(m: Machine, thickness: float):
    """A function of both ends' pressures, the flow in between and that from the valve."""
    inner = 0.25 * math.pi * m.line_inner**2
    half = 0.5 * inner * m.line_length
    inertia = m.density * m.line_length / inner
    laminar = 128.0 * 46e-6 * m.density * thickness * m.line_length / (math.pi * m.line_inner**4)
    turbulent = 0.02 * m.line_length / m.line_inner * 0.5 * m.density / inner**2

    def slopes(valve: float, cylinder: float, flow: float, fed: float):
        drop = laminar * flow + turbulent * flow * abs(flow)
        return modulus_at(m, valve) / half * (fed - flow), (valve - cylinder - drop) / inertia

    return slopes, half


def slopes_of(m: Machine, command: float, temperature: float):
    """The right-hand side under a constant command at the spool."""
    thickness = viscosity_factor(temperature)
    thinner = math.sqrt(1.0 + 0.0007 * (temperature - 40.0))
    m = replace(m, conductance=thinner * m.conductance, body=thinner * m.body)
    lined = m.line_length > 0.0
    line, hose = line_slopes(m, thickness) if lined else (None, 0.0)
    reach = 2.0 * m.damping / m.omega * m.slew
    weight = m.mass * GRAVITY * m.gravity_share

    def slopes(_time: float, y):
        s, ds, av, qa, pa, bv, qb, pb, x, v, ps = y.tolist()
        at_a, at_b = (av, bv) if lined else (pa, pb)
        (in_a, out_a, in_b, out_b), closing = edge_flows(m, s - m.null_shift, ps, at_a, at_b)
        wanted = min(max(command - s - closing, -reach), reach)
        wanted -= m.stiction * math.tanh(ds / STUCK)
        dds = m.omega * (m.omega * wanted - 2.0 * m.damping * ds)
        flow_a, flow_b = in_a - out_a, in_b - out_b
        dav = dqa = dbv = dqb = 0.0
        if lined:
            (dav, dqa), (dbv, dqb) = line(av, pa, qa, flow_a), line(bv, pb, qb, flow_b)
            flow_a, flow_b = qa, qb
        leak = m.leakage / thickness * (pa - pb)
        leak_a, leak_b = (p * m.outer_leakage / thickness for p in (pa, pb))
        volume_a = m.dead_a + hose + m.area_a * (m.half + x)
        volume_b = m.dead_b + hose + m.area_b * (m.half - x)
        dpa = modulus_at(m, pa) / volume_a * (flow_a - m.area_a * v - leak - leak_a)
        dpb = modulus_at(m, pb) / volume_b * (flow_b + m.area_b * v + leak - leak_b)
        force = pa * m.area_a - pb * m.area_b - weight + contact(m, x, v)
        force -= friction_at(m, v, pa + pb, thickness)
        dps = supply_slope(m, ps, in_a + in_b)
        return (ds, dds, dav, dqa, dpa, dbv, dqb, dpb, v, force / m.mass, dps)

    return slopes


def rest_state(machine: Machine, x: float) -> np.ndarray:
    """A state at rest with about half the supply pressure in both chambers."""
    weight = machine.mass * GRAVITY * machine.gravity_share
    total = 0.5 * machine.supply * (machine.area_a + machine.area_b)
    pa = 0.5 * (total + weight) / machine.area_a
    pb = max(0.5 * (total - weight) / machine.area_b, 1e5)
    pa = (pb * machine.area_b + weight) / machine.area_a
    state = np.zeros(11)
    state[[AV, PA, BV, PB, X, PS]] = pa, pa, pb, pb, x, machine.supply
    return state


def run_stroke(
    machine: Machine,
    state: np.ndarray,
    amplitude: float,
    *,
    temperature: float | None = None,
    limit: float | None = None,
) -> Run:
    """A stroke: the valve rests, opens by a step, and centres again.

    Args:
        machine: that makes it.
        state: at its start.
        amplitude: of the command, a share of the spool's stroke, with its sign.
        temperature: of the oil [°C]; None for the machine's.
        limit: distance from mid-stroke at which a limit switch centres the valve [m]; None runs on
            into the end stop.
    """
    temperature = machine.temperature if temperature is None else temperature
    way = math.copysign(1.0, amplitude)
    goal = machine.half - 2e-4 if limit is None else limit

    def arrived(_time, y):
        return way * y[X] - goal

    arrived.terminal = True
    arrived.direction = 1.0
    parts, opened = [], REST
    begin, state = 0.0, _go(machine, state, 0.0, 0.0, REST + machine.delay, temperature, parts)
    begin = REST + machine.delay
    end = _part(machine, state, amplitude, (begin, begin + LONGEST), temperature, arrived)
    parts.append((end.t, end.y))
    state, seen = end.y[:, -1], end.t[-1]
    closed = seen + (PRESSED if limit is None else 0.0)
    state = _go(machine, state, amplitude, seen, closed + machine.delay, temperature, parts)
    last = closed + machine.delay + REST
    _go(machine, state, 0.0, closed + machine.delay, last, temperature, parts)
    knots = np.concatenate([times for times, _ in parts])
    values = np.concatenate([states for _, states in parts], axis=1)
    knots, unique = np.unique(knots, return_index=True)
    values = values[:, unique]
    time = np.arange(0.0, last, ROW)
    rows = np.array([np.interp(time, knots, value) for value in values])
    command = np.where((time >= opened) & (time < closed), amplitude, 0.0)
    at_a, at_b = (AV, BV) if machine.line_length else (PA, PB)
    return Run(
        time, command, rows[X], rows[V], rows[at_a], rows[at_b], rows[PS], rows[S], values[:, -1]
    )


def _go(machine, state, command, begin, end, temperature, parts):
    if end - begin < 1e-6:
        return state
    part = _part(machine, state, command, (begin, end), temperature, None)
    parts.append((part.t, part.y))
    return part.y[:, -1]


def _part(machine, state, command, span, temperature, event):
    times = np.arange(span[0], span[1], ROW)
    found = solve_ivp(
        slopes_of(machine, command, temperature),
        span,
        state,
        method="LSODA",
        t_eval=np.append(times[times < span[1]], span[1]),
        events=event,
        rtol=1e-6,
        atol=1e-6 * SCALES,
        max_step=0.02,
    )
    if found.status < 0:
        raise RuntimeError(found.message)
    if event is not None and len(found.t_events[0]):
        found.t = np.append(found.t, found.t_events[0][0])
        found.y = np.column_stack([found.y, found.y_events[0][0]])
    return found
