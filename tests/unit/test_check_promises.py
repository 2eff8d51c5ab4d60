"""The bench does what `hil-bench check` promises of it.

Each example and drawn machines run with the valve wide open, from end to end. The promise is the
closed form of a steady motion, the bench integrates the equations: neither knows the other.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

from hil_bench.bench.configuration import load_config
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.cli.summary import facts_of

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

WITHIN = 0.03
"""Of a speed: the promise leaves out leakage, and the relief valve's rise above its setting."""
CLOSE = 0.04
"""Of a pressure, as a share of the supply's."""


_SWINGS = 10.0
"""On the way to mid-stroke, in which a machine comes to its steady speed."""


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
        # Half as long again as the promise: a piston that is not through by then is stuck.
        ticks = math.ceil((3.0 * half / (speed or 0.3) + 1.0) / tick)
        rows = []
        for _ in range(ticks):
            rows.append(plant.drive(sign * 1.2 * axis.full_scale, steps)[:4])
            if sign * rows[-1][0] > 0.999 * half:
                break
        self.x, self.v, self.P_A, self.P_B = np.array(rows).T
        self.is_through = bool(sign * self.x[-1] > 0.99 * half)
        self.middle = np.abs(self.x) < 0.2 * half
        self.v = sign * self.v


def promises(config, axis):
    return {fact.name: fact.value for fact in facts_of(config, axis)}


def check_motion(config, axis):
    """Compare top speeds and pressures of both directions."""
    promised = promises(config, axis)
    scale = axis.parameters.P_S
    for word, forward in (("extending", True), ("retracting", False)):
        speed = promised[f"top speed {word}"] * 1e-3
        course = Course(config, axis, forward=forward, speed=speed)
        assert course.is_through == bool(speed)
        if not speed:
            continue
        # Over the middle of the stroke: distance by time, so that a swing does not count.
        inside = np.flatnonzero(course.middle)
        tick = 20 * config.step_ns * 1e-9
        way = abs(course.x[inside[-1]] - course.x[inside[0]])
        seen = way / (tick * (inside[-1] - inside[0]))
        fastest = promised.get(f"  with the accumulator {word}", speed * 1e3) * 1e-3
        assert (1.0 - WITHIN) * speed <= seen <= (1.0 + WITHIN) * fastest
        if fastest > speed:
            continue  # the pressures fall with that of the gas
        for name in ("A", "B"):
            seen = getattr(course, f"P_{name}")[inside].mean()
            right = promised[f"  pressure {name} {word}"] * 1e5
            assert seen == pytest.approx(right, abs=CLOSE * scale), (word, name)


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
    """Compare the force at the end of the stroke, and the pressures at rest."""
    promised, parameters, step = promises(config, axis), axis.parameters, config.step_ns * 1e-9
    plant = axis.kind.build(axis, step, {"position": parameters.h})
    push, before = 0.0, -math.inf
    for _ in range(600):  # a small pump takes its time to fill the chamber
        if abs(push - before) < 1e-6 * promised["largest push"]:
            break
        for _ in range(100):
            _, _, P_A, P_B, *_ = plant.drive(1.2 * axis.full_scale, 20)
        before, push = push, (P_A * parameters.A_A - P_B * parameters.A_B) * 1e-3
    # A relief valve of a pump rises by Q / G above its setting, which the promise names.
    unit = axis.options.supply
    rise = 0.0 if unit is None else unit.pump_flow / unit.relief_gradient / unit.relief_pressure
    assert 0.99 * promised["largest push"] <= push <= (1.01 + rise) * promised["largest push"]
    rest = axis.kind.build(axis, step)
    for name, seen in zip(("A", "B"), rest.output[2:4], strict=True):
        assert seen * 1e-5 == pytest.approx(promised[f"pressure {name} at rest"], abs=0.1)


def check_swing(config, axis):
    """Compare the eigenfrequency at mid-stroke: the time between two turns of the speed."""
    step = config.step_ns * 1e-9
    begin = axis.kind.build(axis, step).output
    names = ("position", "speed", "P_A", "P_B", "spool_position")
    start = dict(zip(names, begin, strict=False)) | {"position": 0.0, "speed": 0.01}
    plant = axis.kind.build(axis, step, start)
    promised = promises(config, axis)["eigenfrequency, mid-stroke"]
    speeds = np.array([plant.drive(0.0, 1)[1] for _ in range(int(2.2 / promised / step))])
    turns = np.flatnonzero(np.diff(np.sign(speeds)) != 0)
    assert 0.5 / ((turns[1] - turns[0]) * step) == pytest.approx(promised, rel=0.02)


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
    swings = 0.2 * axis.parameters.h * promised["eigenfrequency, lowest"] / max(*speeds, 1e-3)
    assume(swings > _SWINGS)
    check_motion(config, axis)
    check_hold(config, axis)


PARITY = {"deadline": None, "derandomize": True, "phases": (Phase.explicit, Phase.generate)}


@settings(max_examples=5, **PARITY)
@given(text=sheets())
def test_a_drawn_machine_moves_as_check_promises(text, tmp_path_factory):
    check_sheet(text, tmp_path_factory.mktemp("sheet"))


def test_a_unit_with_nothing_but_its_pump_is_as_fast_as_the_pump(tmp_path):
    """18 l/min on a bore of 63 mm are 18e-3 / 60 / (pi / 4 0.063²) = 96.2 mm/s."""
    text = SHEET.format(bore=63, rod=36, stroke=500, flow=60, overlap=15, supply=210, mass=300)
    text += 'supply = "unit"\npump_flow_l_min = 18\nrelief_pressure_bar = 210\n'
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    config = load_config(path)
    (axis,) = config.axes
    course = Course(config, axis, forward=True, speed=0.0962)
    assert course.v[course.middle].mean() == pytest.approx(0.0962, rel=0.01)
