"""Eqs. (18)-(24) against Table I worked by hand and against differences of eq. (14)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.analysis.linearisation import (
    CoefficientForm,
    Input,
    Output,
    SecondOrderSystem,
    linearise_full,
    linearise_orifice,
    linearise_reduced,
    linearise_with_valve,
)
from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.steady_motion import OperatingPointError
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions


def load_flow(parameters, z, P_L):
    """Eq. (14)."""
    drop = 0.5 * (parameters.P_S - math.copysign(1.0, z) * P_L)
    return z * parameters.K * math.sqrt(drop)


def test_table_1_gives_the_eigenfrequency_and_damping_of_eqs_19_and_20(table_1):
    system = linearise_reduced(table_1)

    # 2 * 4.85e-3 sqrt(1e8 / (2.35e-3 * 20)) and 2000 / (4 * 4.85e-3) sqrt(2.35e-3 / (1e8 * 20))
    assert system.eigenfrequency == pytest.approx(447.43, abs=0.005)
    assert system.damping_ratio == pytest.approx(0.11175, abs=0.000005)
    assert system.gain == pytest.approx(1.0 / 4.85e-3)
    # -sigma / (2 m) +- j sqrt(447.43² - 50²)
    assert system.poles[0] == pytest.approx(-50.0 + 444.63j, abs=0.01)
    assert system.poles[1] == system.poles[0].conjugate()


def test_an_overdamped_system_has_two_real_poles():
    system = SecondOrderSystem(gain=1.0, eigenfrequency=2.0, damping_ratio=1.25)

    # s² + 5 s + 4 = (s + 1)(s + 4)
    assert system.poles == pytest.approx((-1.0, -4.0))


def test_the_response_has_the_closed_form_at_standstill_eigenfrequency_and_far_beyond():
    system = SecondOrderSystem(gain=3.0, eigenfrequency=2.0 * math.pi * 10.0, damping_ratio=0.1)

    still, own, far = system.response(np.array([0.0, 10.0, 10_000.0]))

    assert still == 3.0
    assert own == pytest.approx(3.0 / 0.2j)  # gain / (2 j zeta)
    assert far == pytest.approx(-3.0e-6, rel=1e-3)  # -gain (10 Hz / 10 kHz)²


@pytest.mark.parametrize(
    ("z", "P_L"), [(5e-5, 5e5), (9.5e-4, 9.5e6), (1e-3, -3e6), (-4e-4, 2e6), (-4e-4, -2e6)]
)
def test_the_consistent_coefficients_are_the_derivatives_of_eq_14(table_1, z, P_L):
    flow = linearise_orifice(table_1, orifice_state=z, load_pressure=P_L)

    dz, dp = 1e-8, 10.0
    by_z = (load_flow(table_1, z + dz, P_L) - load_flow(table_1, z - dz, P_L)) / (2.0 * dz)
    by_p = (load_flow(table_1, z, P_L + dp) - load_flow(table_1, z, P_L - dp)) / (2.0 * dp)
    assert flow.flow_gain == pytest.approx(by_z, rel=1e-7)
    assert flow.flow_pressure_coefficient == pytest.approx(-by_p, rel=1e-7)


def test_the_printed_coefficients_are_those_of_eqs_21_and_22(table_1):
    z, P_L = 5e-4, 4e6
    flow = linearise_orifice(
        table_1, orifice_state=z, load_pressure=P_L, form=CoefficientForm.PRINTED
    )

    assert flow.flow_gain == pytest.approx(table_1.K * math.sqrt(6e6))
    assert flow.flow_pressure_coefficient == pytest.approx(table_1.K * z / (2.0 * math.sqrt(6e6)))


@pytest.mark.parametrize("form", CoefficientForm)
@pytest.mark.parametrize("leakage", [0.0, 2e-11])
def test_eq_24_is_worked_out_right(table_1, form, leakage):
    parameters, frequencies = replace(table_1, C_L=leakage), np.array([0.0, 1.0, 71.0, 600.0])
    system = linearise_with_valve(parameters, orifice_state=9e-4, load_pressure=9e6, form=form)

    flow = linearise_orifice(parameters, orifice_state=9e-4, load_pressure=9e6, form=form)
    s = 2j * np.pi * frequencies
    G = linearise_reduced(parameters).response(frequencies)
    feedback = (flow.flow_pressure_coefficient + leakage) * (20.0 * s + 2000.0) / 4.85e-3
    assert system.response(frequencies) == pytest.approx(flow.flow_gain * G / (1.0 + feedback * G))


def test_a_closed_valve_leaves_eq_18_with_a_gain(table_1):
    system = linearise_with_valve(table_1, orifice_state=0.0, load_pressure=9e6)

    plain = linearise_reduced(table_1)
    assert system.eigenfrequency == plain.eigenfrequency
    assert system.damping_ratio == pytest.approx(plain.damping_ratio)


@pytest.mark.parametrize(
    ("z", "P_L", "message"),
    [
        (1.1e-3, 0.0, "the valve opens to 0.001 m"),
        (math.nan, 0.0, "the valve opens to 0.001 m"),
        (1e-3, 1e7, "must be below the supply's 1e[+]07 Pa"),
        (-1e-3, -1e7, "must be below the supply's 1e[+]07 Pa"),
        (1e-3, -1.1e7, "must be below the supply's"),
        (1e-3, math.nan, "must be below the supply's"),
    ],
)
def test_a_point_that_the_valve_cannot_have_is_refused(table_1, z, P_L, message):
    with pytest.raises(ParameterError, match=message):
        linearise_orifice(table_1, orifice_state=z, load_pressure=P_L)


# The numerical linearisation against derivatives by hand and against eqs. (1) and (24).


def linearised(parameters, **given):
    return linearise_full(parameters, find_operating_point(parameters, **given))


def friction_slope(v):
    """Derivative of eq. (13) with tanh(400 v), Table I, for v > 0, by hand."""
    power = (v / 0.02) ** 0.8
    level = 600.0 + 300.0 * math.exp(-power)
    rise = 400.0 / math.cosh(400.0 * v) ** 2 * level
    fall = math.tanh(400.0 * v) * 300.0 * math.exp(-power) * power * 0.8 / v
    return rise - fall + 2000.0


@pytest.mark.parametrize(("v", "x"), [(0.1, 0.0), (0.015, 0.05), (0.002, -0.1)])
def test_the_jacobian_is_that_by_hand(table_1, v, x):
    model = linearised(table_1, velocity=v, position=x)
    point, K = model.operating_point, table_1.K
    z, E = point.orifice_state, table_1.E
    V_A, V_B = 1.2e-3 + 5e-3 * x, 1.15e-3 - 4.7e-3 * x
    drop_A, drop_B = table_1.P_S - point.pressure_a, point.pressure_b

    expected = np.array(
        [
            [-friction_slope(v) / 20.0, 5e-3 / 20.0, -4.7e-3 / 20.0, 0.0, 0.0],
            [
                -E / V_A * 5e-3,
                -E / V_A * z * K / (2.0 * math.sqrt(drop_A)),
                0.0,
                E / V_A * K * math.sqrt(drop_A),
                0.0,
            ],
            [
                E / V_B * 4.7e-3,
                0.0,
                -E / V_B * z * K / (2.0 * math.sqrt(drop_B)),
                -E / V_B * K * math.sqrt(drop_B),
                0.0,
            ],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0, -(1200.0**2), -2.0 * 0.7 * 1200.0],
        ]
    )
    # Each row in its own unit; 1e-6 is what central differences of the plant leave.
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert pytest.approx(expected / scale, rel=2e-6, abs=1e-12) == model.A / scale
    assert model.B[:, 0] == pytest.approx([0.0, 0.0, 0.0, 0.0, 1200.0**2], rel=1e-6)
    assert model.B[:, 1] == pytest.approx([-1.0 / 20.0, 0.0, 0.0, 0.0, 0.0], rel=1e-6)


@pytest.fixture
def double_rod(table_1):
    """A cylinder for which the reduced model is no reduction: same areas, viscous friction."""
    return replace(
        table_1, A_A=4.85e-3, A_B=4.85e-3, V_A0=1.175e-3, V_B0=1.175e-3, F_c=0.0, F_s=0.0
    )


def test_of_a_double_rod_cylinder_it_is_eq_1_times_eq_24(double_rod):
    model = linearised(double_rod, velocity=0.15, load=20_000.0)
    point, frequencies = model.operating_point, np.array([0.1, 10.0, 71.0, 300.0])

    # (20 kN + 2000 * 0.15 N) / 4.85e-3 m²
    assert point.load_pressure == pytest.approx(20_300.0 / 4.85e-3)
    s = 2j * np.pi * frequencies
    spool = 1200.0**2 / (s**2 + 2.0 * 0.7 * 1200.0 * s + 1200.0**2)
    cylinder = linearise_with_valve(
        double_rod, orifice_state=point.orifice_state, load_pressure=point.load_pressure
    )
    assert model.response(frequencies, Input.SPOOL_SETPOINT, Output.VELOCITY) == pytest.approx(
        spool * cylinder.response(frequencies), rel=1e-5
    )
    assert model.response(frequencies, Input.SPOOL_SETPOINT, Output.ORIFICE_STATE) == pytest.approx(
        spool, rel=1e-5
    )
    assert model.hydraulic_mode == pytest.approx(
        (cylinder.eigenfrequency, cylinder.damping_ratio), rel=1e-5
    )


def test_the_common_pressure_of_both_chambers_is_a_pole_and_a_zero(double_rod):
    model = linearised(double_rod, velocity=0.15)
    z, drop = model.operating_point.orifice_state, 0.5 * (1e7 - 300.0 / 4.85e-3)

    # Pressure that rises in both chambers alike moves nothing: E / V times dQ / dP, by hand.
    common = -1e8 / 1.175e-3 * z * double_rod.K / (2.0 * math.sqrt(drop))
    assert model.poles[0] == pytest.approx(common, rel=1e-5)
    zeros = model.zeros(Input.SPOOL_SETPOINT, Output.VELOCITY)
    assert zeros == pytest.approx([common], rel=1e-4)


def test_the_load_acts_at_once_on_the_velocity_and_not_on_the_spool(table_1):
    model = linearised(table_1, velocity=0.1)

    # Fast, the mass alone resists: v / F = -1 / (m s)
    fast = model.response(np.array([1e5]), Input.LOAD, Output.VELOCITY)
    assert fast == pytest.approx(-1.0 / (20.0 * 2j * np.pi * 1e5), rel=1e-3)
    assert not model.response(np.array([1.0]), Input.LOAD, Output.ORIFICE_STATE).any()
    # From the load, the zeros are the poles of spool and both chambers.
    assert len(model.zeros(Input.LOAD, Output.VELOCITY)) == 4


def test_the_spools_poles_are_those_of_eq_1(table_1):
    poles = linearised(table_1, velocity=0.1).poles

    # -xi omega_0 +- j omega_0 sqrt(1 - xi²)
    assert poles[-2:] == pytest.approx([-840.0 + 856.97j, -840.0 - 856.97j], abs=0.01)


def test_where_the_stribeck_curve_falls_the_motion_is_unstable(table_1):
    # The curve falls between 6.3 and 37 mm/s (differences of eq. (13)); at 15 mm/s its slope takes
    # away more than the orifice gives.
    mode = linearised(table_1, velocity=0.015).hydraulic_mode

    assert mode is not None
    assert mode[1] < 0.0


def test_a_standing_piston_does_not_oscillate_and_hears_nothing_through_the_dead_zone(table_1):
    model = linearised(table_1, velocity=0.0)

    # tanh(400 v): 400 * 900 N + 2000 kg/s on 20 kg
    assert model.hydraulic_mode is None
    assert model.poles[-1].real == pytest.approx(-362_000.0 / 20.0, rel=2e-3)
    assert not model.response(np.array([1.0]), Input.SPOOL_SETPOINT, Output.VELOCITY).any()
    assert model.zeros(Input.SPOOL_SETPOINT, Output.VELOCITY).size == 0


@pytest.mark.parametrize("spool", [3e-4, -3e-4, 1.3e-3, 1.29999e-3])
def test_a_corner_of_eq_2_is_refused(table_1, spool):
    point = find_operating_point(table_1, spool_position=spool)
    with pytest.raises(OperatingPointError, match="has a corner at"):
        linearise_full(table_1, point)


def test_a_saturated_valve_no_longer_hears_its_spool(table_1):
    model = linearised(table_1, spool_position=1.5e-3)

    assert not model.response(np.array([1.0]), Input.SPOOL_SETPOINT, Output.VELOCITY).any()


def test_the_options_of_the_plant_count(table_1):
    # A laminar transition as wide as the supply makes the orifices linear and softer.
    options = PlantOptions(laminar_transition=1e7)
    point = find_operating_point(table_1, options, velocity=0.1)
    model = linearise_full(table_1, point, options)
    drop = 1e7 - point.pressure_a

    gain = 1e8 / 1.2e-3 * table_1.K * drop / (drop**2 + 1e14) ** 0.25
    assert model.A[1, 3] == pytest.approx(gain, rel=1e-5)
