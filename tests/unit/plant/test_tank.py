"""The temperature of the oil of a shared supply against closed forms."""

import json
import math
from dataclasses import replace

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import OILS
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.tank import Tank, TankConfig

TANK = TankConfig(
    oil=OILS["HLP 46"],
    start=40.0,
    volume=1e-3,
    ambient=20.0,
    walls=10.0,
    cooler=100.0,
    cooled_from=50.0,
    efficiency=0.9,
)
CAPACITY = 1e-3 * 875.0 / (1.0 + 7e-4 * 25.0) * 1900.0
"""One litre of 875 kg/m³ at 15 °C, taken at 40 °C [J/K]."""

BENCH = """
[supply.hpu]
pump_flow_l_min = 30
relief_pressure_bar = 100
relief_gradient_l_min_bar = 30
accumulator_volume_l = 0
supply_pressure_bar = 101
oil = "HLP 46"
tank_volume_l = 5
tank_cooling_w_k = 0
pump_efficiency_percent = 80

[plant.lift]
supply = "hpu"
load_n = 5000
position_mm = -190
bulk_modulus_mpa = 1400

[plant.clamp]
supply = "hpu"
orifice_width_mm = 10               # faster than it sticks
bulk_modulus_mpa = 1400

[nodes]
lift_valve = { profile = "valve_408", axis = "lift", node_id = 1 }
clamp_valve = { profile = "valve_408", axis = "clamp", node_id = 2 }
gauge = { profile = "transducer_404", axis = "clamp", source = "P_S", node_id = 3 }
"""


@pytest.fixture
def write(tmp_path):
    def write(old="", new=""):
        path = tmp_path / "bench.toml"
        path.write_text(BENCH.replace(old, new, 1) if old else BENCH)
        return path

    return write


def test_without_cooling_the_oil_warms_by_heat_over_capacity():
    tank = Tank(replace(TANK, walls=0.0, cooler=0.0))
    for _ in range(1000):
        tank.warm(2.0, 1e-3)
    assert tank.temperature == pytest.approx(40.0 + 2000.0 / CAPACITY, rel=1e-12)


@pytest.mark.parametrize(("heat", "steady"), [(250.0, 45.0), (1400.0, 60.0)])
def test_it_comes_to_where_walls_and_cooler_take_the_heat(heat, steady):
    """250 W = 10 W/K * 25 K; 1400 W = 10 W/K * 40 K + 100 W/K * 10 K."""
    tank = Tank(TANK)
    assert TANK.steady(heat) == pytest.approx(steady)
    for _ in range(30_000):
        tank.warm(heat * 0.1, 0.1)
    assert tank.temperature == pytest.approx(steady, abs=1e-6)


def test_on_the_way_there_it_follows_the_exponential():
    tank = Tank(replace(TANK, cooler=0.0))
    for _ in range(60_000):
        tank.warm(0.25, 1e-3)
    rest = 45.0 - 5.0 * math.exp(-60.0 * 10.0 / CAPACITY)
    assert tank.temperature == pytest.approx(rest, rel=1e-6)


def test_an_idle_pump_heats_the_oil_by_all_of_its_power(write):
    """P_R + Q / G = 101 bar; 30 l/min * 101 bar / 0.8 = 6.31 kW in 5 l."""
    with VirtualBench(load_config(write())) as bench:
        bench.run(0.5)
        warm = bench.signals["lift.T_oil"]
        power = 30e-3 / 60.0 * 101e5 / 0.8
        assert warm[-1] - warm[0] == pytest.approx(power * 0.5 / (5.0 * CAPACITY), rel=5e-3)


def test_moving_axes_heat_it_by_what_they_throttle_and_rub(write):
    """Pump and relief valve, edges, friction: each from its own equation, in steady motion."""
    config = load_config(write("pump_efficiency_percent = 80", "pump_efficiency_percent = 100"))
    with VirtualBench(config) as bench:
        for axis in bench.bench.axes:
            axis.command_path.add(lambda _u, full=axis.valve.full_opening: 0.6 * full)
        bench.run(0.7)
        s, plants = bench.signals, [axis.plant.output for axis in bench.bench.axes]
        P_S, heat = plants[0][8], 0.0
        p = paper_parameters()
        for _, v, P_A, P_B, _, _, Q_A, Q_B, *_ in plants:
            friction = p.F_c + (p.F_s - p.F_c) * math.exp(-((v / p.chi) ** p.delta)) + p.sigma * v
            heat += (P_S - P_A) * Q_A - P_B * Q_B + friction * v
        drawn = sum(each[9] for each in plants)
        heat += P_S * (30e-3 / 60.0 - drawn)
        rise = s["lift.T_oil"][-1] - s["lift.T_oil"][-101]
        assert rise * 5.0 * CAPACITY / 0.1 == pytest.approx(heat, rel=2e-3)
        lifted = 5000.0 * plants[0][1]
        assert heat + lifted == pytest.approx(P_S * 30e-3 / 60.0, rel=2e-3)


def test_hot_oil_leaks_by_its_viscosity():
    """At 100 °C HLP 46 has 6.8 mm²/s; chambers even out as exp(-C_L E (1/V_A + 1/V_B) t)."""
    p = replace(paper_parameters(), F_c=1e11, F_s=1e11, C_L=1e-12)
    state = PlantState(0.0, 0.0, 60e5, 40e5, 0.0, 0.0)
    plant = FullOrderPlant(p, options=PlantOptions.bench(), state=state)
    tank = Tank(replace(TANK, start=100.0))
    plant.warm(tank.oil_now())
    end = plant.step(PlantInput(0.0), 20_000)  # 1 s
    dynamic = 6.8 / 46.0 * (1.0 + 7e-4 * 25.0) / (1.0 + 7e-4 * 85.0)
    rate = 1e-12 / dynamic * stiffness(p.E, 60.0) * (1.0 / p.V_A0 + 1.0 / p.V_B0)
    assert end.P_A - end.P_B == pytest.approx(20e5 * math.exp(-rate), rel=1e-4)


def stiffness(E, warmer):
    """1 / E grows by that of the oil, 1 / 1400 MPa, times 10^(0.0024 dT) - 1."""
    return 1.0 / (1.0 / E + (10.0 ** (0.0024 * warmer) - 1.0) / 1.4e9)


@pytest.mark.parametrize(("E", "temperature"), [(1.4e9, 0.0), (1.4e9, 80.0), (0.7e9, 80.0)])
def test_oil_softens_as_it_warms_and_hoses_do_not(E, temperature):
    """A shut chamber that is compressed by 1e-4 of its volume: dP = E dV / V."""
    p = replace(paper_parameters(), E=E, F_c=0.0, F_s=0.0, sigma=0.0)
    plant = FullOrderPlant(p, options=PlantOptions.bench(), dt=1e-6)
    plant.warm(Tank(replace(TANK, start=temperature)).oil_now())
    start = plant.output
    plant.restart(plant.state._replace(v=0.1))
    end = plant.step(PlantInput(0.0), 100)
    per_volume = p.A_B * (end.x - start.x) / p.V_B0
    expected = stiffness(E, temperature - 40.0)
    assert (end.P_B - start.P_B) / per_volume == pytest.approx(expected, rel=2e-3)
    assert plant.modulus == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dynamic", [0.2, 1.0, 14.0])
def test_a_pump_slips_by_thin_oil_and_rubs_in_thick_oil(dynamic):
    """Of 8 % of slip and 4.3 % of drag at 40 °C one half each goes with the viscosity."""
    share, efficiency = replace(TANK, efficiency=0.88, volumetric=0.92).pump_at(dynamic)
    slip = 0.04 + 0.04 / dynamic
    drag = (0.92 / 0.88 - 1.0) * 0.5 * (1.0 + dynamic)
    assert share == pytest.approx((1.0 - slip) / 0.92)
    assert efficiency == pytest.approx((1.0 - slip) / (1.0 + drag))
    if dynamic == 1.0:
        assert (share, efficiency) == pytest.approx((1.0, 0.88))


def test_hot_oil_takes_flow_from_the_pump(write):
    """Idle, P_S is P_R + Q / G; 30 l/min over 30 l/min a bar at 40 °C."""
    config = load_config(
        write("tank_volume_l = 5", "tank_volume_l = 500\nstart_temperature_c = 80")
    )
    with VirtualBench(config) as bench:
        bench.run(0.3)
        a, b = (math.log10(math.log10(nu + 0.7)) for nu in (46.0, 6.8))
        share = math.log10(353.15 / 313.15) / math.log10(373.15 / 313.15)
        nu = 10.0**10.0 ** (a + share * (b - a)) - 0.7
        dynamic = nu / 46.0 * (1.0 + 7e-4 * 25.0) / (1.0 + 7e-4 * 65.0)
        flow = 30.0 * (1.0 - 0.04 - 0.04 / dynamic) / 0.92
        assert bench.signals["lift.P_S"][-1] == pytest.approx((100.0 + flow / 30.0) * 1e5, rel=1e-6)


def test_cold_oil_rubs_and_is_throttled_more(write):
    config = load_config(write("tank_volume_l = 5", "tank_volume_l = 500\nstart_temperature_c = 0"))
    with VirtualBench(config) as bench:
        lift, _ = bench.bench.axes
        lift.command_path.add(lambda _u: 0.4 * lift.valve.full_opening)
        bench.run(0.6)
        found, P_S = lift.plant.output[1], lift.plant.output[8]
    # ASTM D341 through 46 mm²/s at 40 and 6.8 mm²/s at 100 °C, written out
    a, b = (math.log10(math.log10(nu + 0.7)) for nu in (46.0, 6.8))
    share = math.log10(273.15 / 313.15) / math.log10(373.15 / 313.15)
    nu = 10.0**10.0 ** (a + share * (b - a)) - 0.7
    density = (1.0 + 7e-4 * 25.0) / (1.0 - 7e-4 * 15.0)
    p = paper_parameters()
    cold = replace(p, P_S=P_S, sigma=p.sigma * nu / 46.0 * density, rho=p.rho * density)
    z = 0.4 * (p.alpha + p.beta) - p.beta
    motion = steady_motion(cold, PlantOptions.bench(), extends=True, z=z, load=5000.0)
    assert found == pytest.approx(motion.speed, rel=1e-3)
    warm = steady_motion(replace(p, P_S=P_S), PlantOptions.bench(), extends=True, z=z, load=5000.0)
    assert found < 0.98 * warm.speed


def test_a_transducer_measures_it(write):
    with VirtualBench(load_config(write())) as bench:
        bench.run(0.3)
        assert bench.signals["gauge.3.measured"][-1] == bench.signals["clamp.T_oil"][-1] > 40.1


def test_without_a_tank_it_stays_as_it_is(write):
    without = BENCH[BENCH.index("oil =") : BENCH.index("[plant.lift]")]
    with VirtualBench(load_config(write(without, "start_temperature_c = 55\n\n"))) as bench:
        bench.run(0.2)
        assert set(bench.signals["lift.T_oil"]) == {55.0}


def test_check_says_what_the_heat_does(write, capsys):
    path = write("tank_cooling_w_k = 0", "tank_cooling_w_k = 50\ncooler_w_k = 200")
    assert main(["check", "--json", str(path)]) == ExitCode.DONE
    found = {
        fact["name"].strip(): fact["value"]
        for fact in json.loads(capsys.readouterr().out)["summary"]["hpu"]
    }
    heat = 30e-3 / 60.0 * 101e5 / 0.8
    assert found["heat at rest"] == pytest.approx(heat / 1e3)
    assert found["by which the oil warms"] == pytest.approx(heat / (5.0 * CAPACITY) * 60.0)
    # 50 W/K (T - 20) + 200 W/K (T - 50) = heat
    assert found["and comes to"] == pytest.approx((heat + 1000.0 + 10_000.0) / 250.0)


@from_text("old", "new", "said")
def test_what_cannot_be_is_said_in_one_line(write, old, new, said):
    with pytest.raises(ConfigError) as refused:
        load_config(write(old, new))
    assert said in str(refused.value)
