"""The bench does what `hil-bench check` promises of it.

Each example and drawn machines run with the valve wide open, from end to end. The promise is the
closed form of a steady motion, the bench integrates the equations: neither knows the other.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, assume, given, reject, settings
from hypothesis import strategies as st

from hil_bench.bench.configuration import load_config
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.cli.check import facts_of
from hil_bench.plants.hydraulic_cylinder.model.constants import edge_constants, land_constants
from hil_bench.plants.hydraulic_cylinder.model.orifice import edge_openings
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion

EXAMPLES = Path(__file__).parents[2] / "examples"
OWN_SUPPLY = [
    *(EXAMPLES / f"machines/{name}.toml" for name in ("boom", "press", "servo")),
    *(EXAMPLES / f"{name}.toml" for name in ("one_axis", "two_axes", "long_hoses")),
]
"""Other examples repeat the built-in axis, or share a supply (tests/unit/config/test_supplies.py).

The tail lift has a shared one, too.
"""

SHEET = """\
[plant.axis1]
bore_mm = {bore}
rod_mm = {rod}
stroke_mm = {stroke}
rated_flow_l_min = {flow}
rated_pressure_drop_bar = 5
overlap_percent = {overlap}
frequency_90deg_hz = 60
oil = "HLP 46"
supply_pressure_bar = {supply}
load_mass_kg = {mass}
"""
PUMP = """\
supply = "unit"
relief_pressure_bar = {supply}
pump_flow_l_min = {pump}
"""

WINDOW = 0.4
"""The middle of the stroke, over which means are taken, as a share of half the stroke."""
SWINGS = 10.0
"""At least so many are on half of the middle: the machines that drawn data sheets describe."""
SWING = 1.0 / (math.pi * 2.0 * SWINGS)
"""What a swing adds to a mean, as a share of its amplitude: over n periods at most 1 / (pi n)."""
LONGEST = 60.0
"""Until a piston that pushes against its end is at rest [s]."""


class UnsteadyError(AssertionError):
    """The middle of the stroke comes before the steady motion of which `check` speaks.

    A pump that feeds little refills for long what springs out of the chamber at the start.
    """


class Course:
    """A run from one end of the stroke to the other, with the valve wide open.

    Args:
        config: of the bench.
        axis: the cylinder.
        forward: whether it extends.
        speed: promised [m/s].
    """

    def __init__(self, config, axis, *, forward, speed):
        steps, tick = 20, 20 * config.step_ns * 1e-9
        half = axis.parameters.h
        sign = 1.0 if forward else -1.0
        plant = axis.kind.build(axis, config.step_ns * 1e-9, {"position": -sign * half})
        rows = []
        # Half as long again as the promise: whoever is not through by then is stuck.
        for _ in range(math.ceil((3.0 * half / (speed or 0.3) + 1.0) / tick)):
            rows.append(plant.drive(sign * 1.2 * axis.full_scale, steps)[:4])
            if sign * rows[-1][0] > 0.999 * half:
                break
        self.x, _, self.P_A, self.P_B = np.array(rows).T
        self.is_through = bool(sign * self.x[-1] > 0.99 * half)
        self.middle = np.abs(self.x) < 0.5 * WINDOW * half
        self._along = sign * self.x / (0.5 * WINDOW * half)
        self._tick = tick

    def speed(self, begin=-1.0, end=1.0):
        """Return distance by time in the middle of the stroke or a part of it [m/s].

        So a swing hardly counts.
        """
        inside = np.flatnonzero((self._along > begin) & (self._along < end))
        first, last = inside[0], inside[-1]
        return abs(self.x[last] - self.x[first]) / (self._tick * (last - first))

    def means(self):
        """Return the means of P_A and P_B over the middle of the stroke [Pa]."""
        return [pressure[self.middle].mean() for pressure in (self.P_A, self.P_B)]


def promises(config, axis):
    return {fact.name: fact.value for fact in facts_of(config, axis)}


def leakage(axis):
    """Return what can leak past piston, seals and the shut edges [m³/s], at the highest P_S."""
    p, options = axis.parameters, axis.options
    highest = p.P_S + rise(axis)
    closed = 0.0
    if options.has_edges:
        edges = edge_constants(p, options)
        ways = [
            edge_openings(nu, edges, land_constants(options.lands)) for nu in (edges[6], -edges[7])
        ]
        closed = max(ways[0][1], ways[0][2], ways[1][0], ways[1][3])
    seals = (p.C_L + max(options.C_LA, options.C_LB)) * highest
    return seals + 2.0 * p.K * closed * math.sqrt(highest)


def rise(axis):
    """Return by how much a pump lifts P_S above the setting of its relief valve [Pa]: Q / G."""
    unit = axis.options.supply
    return 0.0 if unit is None else unit.pump_flow / unit.relief_gradient


def fastest(axis, *, extends):
    """Return the promise of the same machine under the highest P_S [m/s]; it grows with P_S."""
    p, options, more = axis.parameters, axis.options, rise(axis)
    if options.supply is not None:
        unit = replace(options.supply, relief_pressure=options.supply.relief_pressure + more)
        options = replace(options, supply=unit)
    return steady_motion(p, options, extends=extends).speed


def check_motion(config, axis):
    """Compare top speeds and pressures of both directions.

    Oil that leaks away, at most q, leaves the piston the speed of the promise less q / A of the
    smaller area: then no edge passes more than it does in the promise. Each pressure drop grows
    with the square of the flow.
    """
    promised, p, q = promises(config, axis), axis.parameters, leakage(axis)
    slip = q / min(p.A_A, p.A_B)
    for word, extends in (("extending", True), ("retracting", False)):
        speed = promised[f"top speed {word}"] * 1e-3
        course = Course(config, axis, forward=extends, speed=speed)
        assert course.is_through == bool(speed)
        if not speed:
            continue
        seen = course.speed()
        if abs(course.speed(-1.0, 0.0) - course.speed(0.0, 1.0)) > 2.0 * SWING * seen:
            raise UnsteadyError(word)
        burst = promised.get(f"  with the accumulator {word}", 0.0) * 1e-3
        most = max(burst, fastest(axis, extends=extends)) + slip
        assert (1.0 - SWING) * (speed - slip) <= seen <= (1.0 + SWING) * most, word
        if burst:
            continue  # the pressures fall with that of the gas
        check_pressures(promised, axis, course.means(), (most / speed, word))


def check_pressures(promised, axis, means, motion):
    """Compare the mean pressures of a motion.

    The pressure that drains grows with the square of the flow; the one that feeds carries the load,
    so it differs by as much force.

    Args:
        promised: facts by name.
        axis: the cylinder.
        means: of P_A and P_B [Pa].
        motion: by how much it can be faster than promised, and its name.
    """
    p, (faster, word) = axis.parameters, motion
    right = [promised[f"  pressure {name} {word}"] * 1e5 for name in "AB"]
    fed, other = (p.A_A, p.A_B) if word == "extending" else (p.A_B, p.A_A)
    drained = right[1] if word == "extending" else right[0]
    more = (faster**2 - 1.0) * max(drained - p.P_T, 0.0) * max(1.0, other / fed)
    for seen, each, name in zip(means, right, "AB", strict=True):
        assert seen == pytest.approx(each, abs=more + SWING * p.P_S), (word, name)


@pytest.mark.parametrize("path", OWN_SUPPLY, ids=lambda path: path.stem)
def test_an_example_moves_as_check_promises(path):
    config = load_config(path)
    for axis in config.axes:
        check_motion(config, axis)


def test_the_servo_axis_swings_and_pushes_as_check_promises():
    config = load_config(EXAMPLES / "machines/servo.toml")
    check_hold(config, config.first_axis)
    check_swing(config, config.first_axis)


def check_hold(config, axis):
    """Compare the force at the end of the stroke, and the pressures at rest.

    The pump lifts P_S by Q / G, which the promise names; what leaks drops over the open edges.
    """
    promised, p, step = promises(config, axis), axis.parameters, config.step_ns * 1e-9
    plant = axis.kind.build(axis, step, {"position": p.h})
    push, before = 0.0, -math.inf
    for _ in range(math.ceil(LONGEST / 0.1)):
        for _ in range(math.ceil(0.1 / (20 * step))):
            _, _, P_A, P_B, *_ = plant.drive(1.2 * axis.full_scale, 20)
        before, push = push, P_A * p.A_A - P_B * p.A_B
        if abs(push - before) < 1e-6 * p.P_S * p.A_A:
            break
    setting = promised["largest push"] * 1e3
    lost = 2.0 * (leakage(axis) / (p.K * p.alpha)) ** 2 * p.A_A
    floor = 1e-5 * setting
    assert setting - lost - floor <= push <= setting + rise(axis) * p.A_A + floor
    rest = axis.kind.build(axis, step)
    for name, seen in zip(("A", "B"), rest.output[2:4], strict=True):
        assert seen * 1e-5 == pytest.approx(promised[f"pressure {name} at rest"], abs=1e-6)


def check_swing(config, axis):
    """Compare the eigenfrequency at mid-stroke: the time between two turns of the speed."""
    step = config.step_ns * 1e-9
    begin = axis.kind.build(axis, step).output
    names = ("position", "speed", "P_A", "P_B", "spool_position")
    start = dict(zip(names, begin, strict=False)) | {"position": 0.0, "speed": 0.01}
    plant = axis.kind.build(axis, step, start)
    found = promises(config, axis)
    damping = found["damping ratio there"]  # a damped swing is slower
    promised = found["eigenfrequency, mid-stroke"] * math.sqrt(1.0 - damping**2)
    speeds = np.array([plant.drive(0.0, 1)[1] for _ in range(int(2.2 / promised / step))])
    turns = np.flatnonzero(np.diff(np.sign(speeds)) != 0)
    # Two turns are seen to a step each.
    half = (turns[1] - turns[0]) * step
    assert half == pytest.approx(0.5 / promised, abs=2.0 * step)


@st.composite
def sheets(draw):
    """Data sheets of machines that nobody doubts, with and without a pump."""
    bore = draw(st.integers(25, 160))
    sheet = {
        "bore": bore,
        "rod": draw(st.integers(bore // 3, int(0.75 * bore))),
        "stroke": draw(st.integers(600, 1500)),
        "flow": draw(st.integers(4, 120)),
        "overlap": draw(st.sampled_from([0, 5, 20])),
        "supply": draw(st.integers(60, 300)),
        "mass": draw(st.integers(10, 500)),
    }
    text = SHEET.format(**sheet)
    if draw(st.booleans()):
        text += PUMP.format(pump=draw(st.integers(4, 200)), **sheet)
    return text


def check_sheet(text, folder):
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    config = load_config(path)
    assume(not find_doubts(config))
    (axis,) = config.axes
    promised = promises(config, axis)
    speeds = [promised[f"top speed {word}"] * 1e-3 for word in ("extending", "retracting")]
    slowest = promised["eigenfrequency, lowest"]
    swings = 0.5 * WINDOW * axis.parameters.h * slowest / max(*speeds, 1e-3)
    assume(swings > SWINGS)
    try:
        check_motion(config, axis)
    except UnsteadyError:
        reject()  # hypothesis complains where that befalls many
    check_hold(config, axis)


PARITY = {"deadline": None, "derandomize": True, "phases": (Phase.explicit, Phase.generate)}


@settings(max_examples=5, **PARITY)
@given(text=sheets())
def test_a_drawn_machine_moves_as_check_promises(text, tmp_path_factory):
    check_sheet(text, tmp_path_factory.mktemp("sheet"))


@pytest.mark.long
@settings(max_examples=50, **PARITY)
@given(text=sheets())
def test_many_drawn_machines_move_as_check_promises(text, tmp_path_factory):
    check_sheet(text, tmp_path_factory.mktemp("sheet"))


def test_a_unit_with_nothing_but_its_pump_is_as_fast_as_the_pump(load_bench):
    """18 l/min on a bore of 63 mm are 18e-3 / 60 / (pi / 4 0.063²) = 96.2 mm/s."""
    text = SHEET.format(bore=63, rod=36, stroke=500, flow=60, overlap=15, supply=210, mass=300)
    text += 'supply = "unit"\npump_flow_l_min = 18\nrelief_pressure_bar = 210\n'
    config = load_bench(text)
    (axis,) = config.axes
    course = Course(config, axis, forward=True, speed=0.0962)
    assert course.speed() == pytest.approx(0.0962, rel=0.01)
    notes = {fact.name: fact.note for fact in facts_of(config, axis)}
    # 18 l/min over 12 l/min a bar
    words = "at the relief valve's setting, P_S rises by up to 1.5 bar"
    for name in ("top speed extending", "largest push", "largest pull"):
        assert notes[name].endswith(words)


def test_a_swing_is_counted_in_ticks_and_in_steps():
    """By default a tick has 1 ms and a step 50 us; the fastest swing needs the steps."""
    config = load_config()
    facts = {fact.name.strip(): fact.value for fact in facts_of(config, config.axes[0])}
    places = ("retracted", "mid-stroke", "extended", "lowest")
    frequencies = [facts[f"eigenfrequency, {place}"] for place in places]
    assert facts["steps a swing"] == pytest.approx(1.0 / (max(frequencies) * 50e-6))
    assert facts["ticks a swing"] == pytest.approx(1.0 / (min(frequencies) * 1e-3))
