"""No oil and no energy is lost: what comes in at the ports is found again."""

import itertools
import math

import pytest
from support.motors import STEP

from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force

D, E, V, J = 1e-5, 1e9, 2e-4, 0.05
LITRE_PER_MINUTE_BAR = 1e-3 / 60.0 / 1e5
ANGLE, SPEED, P_A, P_B, SPOOL, TORQUE, Q_A, Q_B = range(8)


def run(plant, openings):
    """Return the outputs at each step of a manoeuvre in pieces of 10 ms."""
    rows = [plant.output]
    for opening in openings:
        rows += [plant.drive(opening * 1e-3, 1) for _ in range(200)]
    return rows


def integral(values):
    """Return the integral over time, by the trapezoidal rule."""
    return STEP * (sum(values) - 0.5 * (values[0] + values[-1]))


@pytest.mark.parametrize("leak", [0.0, 0.02])
def test_the_oil_of_a_side_is_turned_squeezed_or_leaked(motor, leak):
    _, plant = motor(internal_leakage_l_min_bar=leak, external_leakage_a_l_min_bar=leak / 2)
    rows = run(plant, [0.3, 0.8, 0.8, -0.5, -0.5, 0.1])
    C = leak * LITRE_PER_MINUTE_BAR
    came = integral([row[Q_A] for row in rows])
    turned = D * (rows[-1][ANGLE] - rows[0][ANGLE])
    squeezed = V / E * (rows[-1][P_A] - rows[0][P_A])
    void = plant.model.state.V_CA  # the braking inertia pulls a cavity, which is no oil
    leaked = integral([C * (row[P_A] - row[P_B]) + 0.5 * C * row[P_A] for row in rows])
    displaced = D * sum(abs(b[ANGLE] - a[ANGLE]) for a, b in itertools.pairwise(rows))
    assert came == pytest.approx(turned + squeezed + leaked - void, abs=1e-4 * displaced)
    assert void > 0.05 * displaced
    if leak:
        assert leaked > 1e-3 * displaced


def test_the_energy_of_the_ports_is_found_again(motor):
    config, plant = motor(
        coulomb_friction_n_m=4,
        static_friction_n_m=8,
        viscous_friction_n_m_s=0.1,
        internal_leakage_l_min_bar=0.02,
        load_torque_n_m=20,
    )
    rows = run(plant, [0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.4, 0.4])
    assert plant.model.state.V_CA == plant.model.state.V_CB == 0.0
    r, p = config.lever, config.cylinder.parameters
    gain = config.cylinder.options.tanh_gain
    curve = (p.F_c, p.F_s - p.F_c, p.sigma, math.log(p.chi), p.delta, gain)
    C = 0.02 * LITRE_PER_MINUTE_BAR
    came = integral([row[P_A] * row[Q_A] + row[P_B] * row[Q_B] for row in rows])
    moved = 0.5 * J * (rows[-1][SPEED] ** 2 - rows[0][SPEED] ** 2)
    squeezed = sum(0.5 * V / E * (rows[-1][port] ** 2 - rows[0][port] ** 2) for port in (P_A, P_B))
    rubbed = integral([friction_force(row[SPEED] * r, curve) * row[SPEED] * r for row in rows])
    lifted = 20.0 * (rows[-1][ANGLE] - rows[0][ANGLE])
    leaked = integral([C * (row[P_A] - row[P_B]) ** 2 for row in rows])
    turned_over = integral([abs(row[P_A] * row[Q_A]) + abs(row[P_B] * row[Q_B]) for row in rows])
    assert came == pytest.approx(
        moved + squeezed + rubbed + lifted + leaked, abs=1e-4 * turned_over
    )
    assert min(moved, rubbed, lifted, leaked) > 1e-3 * turned_over
