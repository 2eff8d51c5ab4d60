"""The valve as four edges: overlaps of their own, leakage in the centre, a pressure compensator."""

import math
from dataclasses import replace

import pytest
from scipy.optimize import brentq

from hil_bench.bench.configuration import load_config
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import NullEdge, null_flow, null_opening
from hil_bench.plants.hydraulic_cylinder.model.extensions import MeteringLands, SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver

TURBULENT = replace(PlantOptions.bench(), laminar_transition=0.0)
SYMMETRIC = replace(paper_parameters(), A_B=50e-4, V_B0=1.2e-3, beta=0.0)
X_0 = 50e-6
LEAKY = MeteringLands(null_opening=X_0)


def plant(lands, parameters=SYMMETRIC, **options):
    options = {"solver": Solver.LINEARLY_IMPLICIT_MIDPOINT, "dt": 5e-5} | options
    given = {name: options.pop(name) for name in ("solver", "dt")}
    start = options.pop("state", PlantState(0.0, 0.0, 30e5, 30e5, 0.0, 0.0))
    return FullOrderPlant(
        parameters, options=replace(TURBULENT, lands=lands, **options), state=start, **given
    )


def test_the_pressures_of_a_matched_valve_in_its_centre_go_to_the_middle():
    """P_A = P_B = (P_S + P_T) / 2, whatever they begin with."""
    output = plant(LEAKY).step(PlantInput(0.0), 400_000)
    assert pytest.approx(50e5, rel=1e-4) == output.P_A
    assert pytest.approx(50e5, rel=1e-4) == output.P_B
    assert output.v == pytest.approx(0.0, abs=1e-9)


def test_a_closed_cylinder_drifts_under_its_load():
    """v = K x_0 (sqrt(P_S / 2 + d) - sqrt(P_S / 2 - d)) / A with d = (F + f(v)) / (2 A)."""
    p = SYMMETRIC
    force = -2e4

    def excess(v):
        friction = p.F_c + (p.F_s - p.F_c) * math.exp(-((v / p.chi) ** p.delta))
        held = math.tanh(400.0 * v) * friction + p.sigma * v + force
        d = held / (2.0 * p.A_A)
        flow = p.K * X_0 * (math.sqrt(50e5 - d) - math.sqrt(50e5 + d))
        return flow - p.A_A * v

    expected = brentq(excess, 1e-9, 1e-2, xtol=1e-15)
    moving = plant(LEAKY, state=PlantState(0.0, 0.0, 50e5 - 2e6, 50e5 + 2e6, 0.0, 0.0))
    moving.step(PlantInput(0.0, force), 400_000)
    output = moving.step(PlantInput(0.0, force), 20_000)
    assert output.v == pytest.approx(expected, rel=1e-3)
    assert expected > 1e-5


def test_the_leakage_falls_with_the_overlap_as_eryilmaz_and_wilson_have_it():
    """x_0² / (x_0 + beta): at 0.3 mm of overlap and x_0 = 50 um it is 7.1 um."""
    p = replace(SYMMETRIC, beta=0.3e-3)
    output = plant(LEAKY, p).output
    opening = 2500e-12 / 350e-6
    flow = p.K * opening * (math.sqrt(70e5) - math.sqrt(30e5))
    assert output.Q_A == pytest.approx(flow, rel=1e-12)


@pytest.mark.parametrize(
    ("nu", "edge", "name"),
    [
        (0.5e-3, "gain_pa", "overlap_pa"),
        (0.5e-3, "gain_bt", "overlap_bt"),
        (-0.5e-3, "gain_at", "overlap_at"),
        (-0.5e-3, "gain_pb", "overlap_pb"),
    ],
)
def test_each_edge_opens_beyond_its_own_overlap(nu, edge, name):
    lands = MeteringLands(**{name: 0.1e-3, edge: 0.5})
    p = replace(paper_parameters(), beta=0.4e-3)
    start = PlantState(0.0, 0.0, 40e5, 40e5, nu, 0.0)
    output = plant(lands, p, state=start).output
    own, other = (0.5 * 0.4e-3, 0.1e-3)
    openings = [own if name[-2:] in pair else other for pair in (("pa", "at"), ("pb", "bt"))]
    drops = (60e5, 40e5) if nu > 0.0 else (40e5, 60e5)
    sign = math.copysign(1.0, nu)
    for found, opening, drop, way in zip(
        (output.Q_A, output.Q_B), openings, drops, (sign, -sign), strict=True
    ):
        assert found == pytest.approx(way * p.K * opening * math.sqrt(drop), rel=1e-9)


def test_an_underlap_lets_a_port_to_the_tank_in_the_centre():
    """A closed-centre spool keeps 30 bar; edges to the tank that are open by 0.2 mm do not."""
    floating = MeteringLands(overlap_at=-0.2e-3, overlap_bt=-0.2e-3)
    p = replace(SYMMETRIC, beta=0.3e-3)
    assert pytest.approx(30e5) == plant(None, p).step(PlantInput(0.0), 20_000).P_A
    assert plant(floating, p).step(PlantInput(0.0), 20_000).P_A < 1.0


def test_the_wide_open_valve_passes_what_it_does_without_leakage():
    start = PlantState(0.0, 0.0, 40e5, 40e5, 2e-3, 0.0)
    plain, leaky = plant(None, state=start).output, plant(LEAKY, state=start).output
    back = SYMMETRIC.K * 2500e-12 / 1050e-6 * math.sqrt(40e5)
    assert leaky.Q_A == pytest.approx(plain.Q_A - back, rel=1e-6)


@pytest.mark.parametrize(
    ("solver", "tolerance"),
    [(Solver.FORWARD_EULER, 1e-3), (Solver.LINEARLY_IMPLICIT_MIDPOINT, 1e-4)],
)
@pytest.mark.parametrize("supply", [None, SupplyUnit()])
def test_all_solvers_step_the_same_edges(solver, tolerance, supply):
    lands = MeteringLands(
        gain_pb=0.84, saturation=1.0, overlap_pa=0.2e-3, overlap_bt=-0.1e-3, null_opening=8e-6
    )
    with_margin = {"compensator_margin": 15e5, "supply": supply}
    reference = plant(lands, solver=Solver.RUNGE_KUTTA, dt=5e-6, **with_margin)
    other = plant(lands, solver=solver, dt=5e-6, **with_margin)
    for opening in (1e-3, 0.0, -0.7e-3):
        wanted = reference.step(PlantInput(opening), 10_000)
        found = other.step(PlantInput(opening), 10_000)
        assert found.x == pytest.approx(wanted.x, abs=2e-5)
        assert found.v == pytest.approx(wanted.v, abs=tolerance)
        assert other.extension.P_S == pytest.approx(reference.extension.P_S, rel=1e-4)


@pytest.mark.parametrize("load", [0.0, 1e4, 2e4])
def test_a_compensated_valve_moves_every_load_at_one_speed(load):
    """v = K z sqrt(margin) / A_A, as long as the supply has the margin to spare.

    Without the falling Stribeck curve: a source of constant flow damps no stick-slip.
    """
    p = replace(paper_parameters(), F_s=600.0)
    options = {"compensator_margin": 10e5, "state": PlantState(-0.15, 0.0, 30e5, 30e5, 0.0, 0.0)}
    output = plant(None, p, **options).step(PlantInput(0.6e-3, load), 80_000)
    assert output.v == pytest.approx(p.K * 0.3e-3 * math.sqrt(10e5) / p.A_A, rel=1e-5)


def test_a_compensator_lets_nothing_back_to_the_supply():
    """A pull that squeezes A beyond 100 bar stands on the check valve."""
    p = paper_parameters()
    start = PlantState(0.0, 0.0, 120e5, 5e5, 0.6e-3, 0.0)
    assert plant(None, p, state=start).output.Q_A < 0.0
    assert plant(None, p, state=start, compensator_margin=10e5).output.Q_A == 0.0


def test_the_leakage_of_a_data_sheet_is_what_the_valve_leaks():
    """1.2 l/min at 140 bar through a centred valve with blocked ports, by its edges."""
    keys = {
        "rated_flow_l_min": 40,
        "rated_pressure_drop_bar": 35,
        "overlap_percent": 0,
        "frequency_90deg_hz": 90,
        "null_leakage_l_min": 1.2,
        "null_leakage_pressure_bar": 140,
        "supply_pressure_bar": 140,
    }
    axis = load_config(tables={"plant": {"axis1": keys}}).axes[0]
    lands = axis.options.lands
    start = PlantState(0.0, 0.0, 70e5, 70e5, 0.0, 0.0)
    output = plant(lands, axis.parameters, state=start).output
    # in the middle as much comes as goes: what one edge passes is half of the leakage
    assert output.Q_A == pytest.approx(0.0, abs=1e-15)
    assert axis.parameters.K * lands.null_opening * math.sqrt(70e5) == pytest.approx(0.6e-3 / 60.0)
    assert lands.null_opening * 1e6 == pytest.approx(10.607, rel=1e-4)  # alpha 0.6/40 sqrt(35/70)


@pytest.mark.parametrize("overlap", [0.0, 2e-4, -1e-6])
def test_the_opening_that_leaks_is_found_for_any_edges(overlap):
    edges = [NullEdge(overlap, 1e-3 - overlap, gain) for gain in (1.0, 1.0, 0.5, 0.5)]
    x_0 = null_opening(3e-6, edges, 1.5)
    assert null_flow(x_0, edges, 1.5) == pytest.approx(3e-6, rel=1e-9)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(
        ParameterError, match=r"overlap_at = 0\.002 m: must be less than the spool's"
    ):
        plant(MeteringLands(overlap_at=2e-3))
    with pytest.raises(ParameterError, match=r"null_opening = 0\.001 m: must be less"):
        plant(MeteringLands(null_opening=1e-3))
    with pytest.raises(ParameterError, match="no place for lands"):
        ReducedOrderPlant(paper_parameters(), options=PlantOptions(lands=LEAKY))
    with pytest.raises(ConfigError, match="land_overlap_pa_mm: "):
        load_config(tables={"plant": {"axis1": {"land_overlap_pa_mm": 5}}})
    sheet = {
        "rated_flow_l_min": 60,
        "rated_pressure_drop_bar": 5,
        "overlap_percent": 10,
        "frequency_90deg_hz": 50,
    }
    for more, message in (
        ({"null_leakage_l_min": 1}, "null_leakage_pressure_bar: missing"),
        (
            {"null_leakage_l_min": 5000, "null_leakage_pressure_bar": 100},
            "5000 l/min is no leakage of these edges",
        ),
    ):
        with pytest.raises(ConfigError, match=message):
            load_config(tables={"plant": {"axis1": sheet | more}})
