"""The motor against what Merritt and a sheet of paper say of it.

D = 1e-5 m³/rad, E = 1e9 Pa, V = 2e-4 m³ a side, J = 0.05 kg m², 60 l/min at 35 bar, 210 bar.
"""

import itertools
import math

import pytest
from support.motors import STEP

from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force

D, E, V, J = 1e-5, 1e9, 2e-4, 0.05
RATED_FLOW, RATED_DROP, SUPPLY = 1e-3, 35e5, 210e5
OPEN = 1e-3  # [m], the typical stroke of a spool without overlap
ANGLE, SPEED, P_A, P_B, SPOOL, TORQUE, Q_A, Q_B = range(8)


@pytest.mark.parametrize(
    ("load", "direction"), [(0.0, 1), (0.0, -1), (90.0, 1), (90.0, -1), (-60.0, 1)]
)
def test_top_speed_is_flow_by_displacement(motor, load, direction):
    _, plant = motor(load_torque_n_m=load)
    seen = plant.drive(direction * OPEN, 60_000)
    # Both edges share P_S - M / D in equal parts.
    drop = 0.5 * (SUPPLY - direction * load / D)
    flow = RATED_FLOW * math.sqrt(drop / RATED_DROP)
    assert seen[SPEED] == pytest.approx(direction * flow / D, rel=1e-6)
    assert seen[Q_A] == pytest.approx(direction * flow, rel=1e-6)
    assert seen[Q_B] == pytest.approx(-seen[Q_A], rel=1e-6)
    assert seen[TORQUE] == pytest.approx(load, abs=1e-4)


def test_stalls_at_the_supply_pressure_by_displacement(motor):
    # 210 bar · 1e-5 m³/rad = 210 N m
    _, pulling = motor(load_torque_n_m=209.0, viscous_friction_n_m_s=5.0)
    _, pulled = motor(load_torque_n_m=211.0, viscous_friction_n_m_s=5.0)
    assert pulling.drive(OPEN, 40_000)[SPEED] > 0.1
    assert pulled.drive(OPEN, 40_000)[SPEED] < -0.1


def test_swings_on_the_oil_at_the_hydraulic_eigenfrequency(motor):
    # omega = D sqrt(2 E / (V J)) = 1e-5 sqrt(2e9 / 1e-5) = 141.4 rad/s, 22.5 Hz
    omega = D * math.sqrt(2.0 * E / (V * J))
    assert omega == pytest.approx(141.42, rel=1e-4)
    _, plant = motor()
    plant.go_to({"speed": 1.0})
    crossings = []
    before = plant.output[SPEED]
    for step in range(1, 20_000):
        speed = plant.drive(0.0, 1)[SPEED]
        if before > 0.0 >= speed:
            crossings.append((step - speed / (speed - before)) * STEP)
        before = speed
    periods = len(crossings) - 1
    assert periods > 15
    measured = 2.0 * math.pi * periods / (crossings[-1] - crossings[0])
    assert measured == pytest.approx(omega, rel=1e-5)
    assert max(abs(plant.drive(0.0, 1)[SPEED]) for _ in range(1000)) > 0.99  # nothing damps it


def test_swings_by_both_volumes(motor):
    config, _ = motor(volume_b_cm3=50)
    facts = {fact.name: fact for fact in config.kind.summarise(config, 1000, 50)}
    # D sqrt(E (1 / V_A + 1 / V_B) / J) = 1e-5 sqrt(1e9 · 25e3 / 0.05) = 223.6 rad/s
    assert facts["eigenfrequency"].value == pytest.approx(223.607 / (2.0 * math.pi), rel=1e-5)


def test_coasts_by_its_time_constant(motor):
    """Without oil to hold it, the speed falls as exp(-t b / J): both lines cavitate to the tank."""
    _, plant = motor(load_viscous_n_m_s=0.5, supply_pressure_bar=1, cavitation_floor_bar=0)
    plant.go_to({"speed": 100.0, "P_A": 0.0, "P_B": 0.0})
    # The valve is closed: a line empties and the other one fills; so compare the first moment.
    first = plant.drive(0.0, 1)[SPEED]
    assert first == pytest.approx(100.0 * math.exp(-STEP * 0.5 / J), abs=2e-3)


def test_efficiencies_hold_at_the_rated_point(motor):
    rated = {
        "coulomb_friction_n_m": None,
        "rated_speed_rpm": 600,
        "rated_pressure_bar": 150,
        "volumetric_efficiency_percent": 94,
        "hydromechanical_efficiency_percent": 90,
    }
    speed, drop = 600.0 * math.tau / 60.0, 150e5
    config, _ = motor(**rated)
    # At the rated point the shaft gives eta_hm D dp and the motor takes D omega / eta_v.
    flow = D * speed / 0.94
    edges = 2.0 * RATED_DROP * (flow / RATED_FLOW) ** 2
    _, plant = motor(
        **rated, load_torque_n_m=0.9 * D * drop, supply_pressure_bar=(drop + edges) * 1e-5
    )
    seen = plant.drive(OPEN, 60_000)
    assert seen[SPEED] == pytest.approx(speed, rel=1e-4)
    assert seen[Q_A] == pytest.approx(flow, rel=1e-4)
    assert seen[P_A] - seen[P_B] == pytest.approx(drop, rel=1e-4)
    facts = {fact.name: fact for fact in config.kind.summarise(config, 1000, 50)}
    lost = 0.1 * D * drop  # 15 N m: half of it Coulomb's, twice as much at the start
    assert facts["  at the start"].value == pytest.approx(210.0 - 2.0 * lost, rel=1e-9)


def test_holds_a_load_behind_the_closed_valve(motor):
    _, plant = motor(load_torque_n_m=300.0)  # more than the 210 N m that the supply could give
    start = plant.output
    assert start[P_A] - start[P_B] == pytest.approx(300e5)
    assert start[P_B] >= 0.0
    seen = plant.drive(0.0, 20_000)
    assert seen[SPEED] == pytest.approx(0.0, abs=1e-9)
    assert seen[ANGLE] == pytest.approx(0.0, abs=1e-9)


def test_takes_a_torque_over_time(motor):
    """The shaft gives way by M V / (2 E D²) = 20 · 2e-4 / (2e9 · 1e-10) = 0.02 rad, as a spring."""
    _, plant = motor(load_series_s_n_m="[[0.1, 0.0], [5.0, 20.0]]", viscous_friction_n_m_s=2)
    assert plant.drive(0.0, 140_000)[ANGLE] == pytest.approx(-0.02, rel=1e-3)


# No oil and no energy is lost: what comes in at the ports is found again.


LITRE_PER_MINUTE_BAR = 1e-3 / 60.0 / 1e5


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
