"""A motor behind lines with waves, against what the wave equation says of it."""

import math

import pytest
from support.motors import LOSSLESS, STEP, write_bench

from hil_bench import ConfigError, load_config

D, E, V, J = 1e-5, 1e9, 2e-4, 0.05
LINES = {
    "line_model": '"waves"',
    "line_a_length_m": 4.0,
    "line_a_inner_mm": 12,
    "line_b_length_m": 2.0,
    "line_b_inner_mm": 12,
    "oil_viscosity_mm2_s": 1e-4,
}
SPEED, AT_A, AT_B = 1, 8, 9
AREA = 0.25 * math.pi * 0.012**2


def line(length):
    """Wave time in whole steps [s], and the impedance that keeps the compliance [Pa s/m³]."""
    time = round(length / math.sqrt(E / 850.0) / STEP) * STEP
    return time, time * E / (AREA * length)


def test_swings_on_oil_and_lines(motor):
    """J w² = D² (1 / (V / E + tan(w T) / (w Z))) of both ports, by halving."""
    low, high = 1.0, D * math.sqrt(2.0 * E / (V * J))
    for _ in range(60):
        omega = 0.5 * (low + high)
        stiffness = 0.0
        for length in (4.0, 2.0):
            time, impedance = line(length)
            stiffness += D * D / (V / E + math.tan(omega * time) / (omega * impedance))
        low, high = (omega, high) if stiffness > J * omega * omega else (low, omega)
    assert omega < 0.8 * D * math.sqrt(2.0 * E / (V * J))
    _, plant = motor(**LINES)
    plant.go_to({"speed": 1.0})
    crossings, before = [], 1.0
    for step in range(1, 12_000):
        speed = plant.drive(0.0, 1)[SPEED]
        if before > 0.0 >= speed:
            crossings.append((step - speed / (speed - before)) * STEP)
        before = speed
    periods = len(crossings) - 1
    assert periods > 5
    assert 2.0 * math.pi * periods / (crossings[-1] - crossings[0]) == pytest.approx(
        omega, rel=2e-3
    )


def test_a_valve_that_shuts_sends_a_surge(motor):
    """dp = Z q within the time there and back (Joukowsky), less what the spool takes to shut."""
    _, plant = motor(**LINES, spool_natural_frequency_rad_s=20_000, frequency_90deg_hz=None)
    for _ in range(400):
        seen = plant.drive(1e-3, 100)
    _, impedance = line(2.0)
    before, flow = seen[AT_B], -seen[7]
    highest = max(plant.drive(0.0, 1)[AT_B] for _ in range(30))
    assert highest - before == pytest.approx(impedance * flow, rel=0.02)


def test_the_pressures_at_the_valve_are_recorded(tmp_path):
    only_b = {**LOSSLESS, **LINES, "line_a_length_m": None, "line_a_inner_mm": None}
    (axis,) = load_config(write_bench(tmp_path, only_b)).axes
    names = [each.name for each in axis.kind.outputs if each.is_recorded]
    assert names[-1] == "P_B_valve"
    assert "P_A_valve" not in names


def test_waves_without_a_line_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"line_model: waves need a line; give line_a_length_m"):
        load_config(write_bench(tmp_path, {**LOSSLESS, "line_model": '"waves"'}))
