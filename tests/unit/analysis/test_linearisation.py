"""Eqs. (18)-(24) against Table I worked by hand and against differences of eq. (14)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.analysis.linearisation import (
    CoefficientForm,
    SecondOrderSystem,
    linearise_orifice,
    linearise_reduced,
    linearise_with_valve,
)
from hil_bench.errors import ParameterError


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
