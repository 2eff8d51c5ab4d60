"""Faults of the plant against closed forms; each expected number comes from the formula named."""

import math
from dataclasses import replace

import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.panel.bench_link import fault_choices
from hil_bench.plants.hydraulic_cylinder.model.chamber import bulk_modulus
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects
from hil_bench.plants.hydraulic_cylinder.model.extensions import EntrainedAir
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_drivers import Network, ProportionalValve

LEAK = 1e-11
"""[m³/(s Pa)], 0.06 l/min a bar."""


def held_plant(**options):
    """Return a plant whose piston nothing moves, at 50 bar in both chambers."""
    parameters = replace(paper_parameters(), F_c=1e11, F_s=1e11)
    state = PlantState(0.0, 0.0, 50e5, 50e5, 0.0, 0.0)
    return FullOrderPlant(parameters, options=replace(PlantOptions.bench(), **options), state=state)


def bench_of(**keys):
    return VirtualBench(load_config(tables={"plant": {"axis1": keys}}))


def plant_of(bench):
    plant = bench.bench.axes[0].plant
    return getattr(plant, "model", plant)  # one with a supply unit is in a frame that shows P_S


def opened(bench, share):
    """Run the axis with its valve at a share of its opening for 0.4 s; return the final speed."""
    with Network(bench.bus, clock=bench.bus.now) as network:
        valve = ProportionalValve(network, node_id=1)
        valve.setup()
        network.start_node(1)
        valve.enable()
        for _ in range(40):
            valve.spool_setpoint = share
            network.pump_until(network.now() + 0.01)
        return plant_of(bench).output.v


@pytest.mark.parametrize(("defect", "chamber"), [("leakage_a", "P_A"), ("leakage_b", "P_B")])
def test_a_chamber_that_leaks_loses_its_pressure_exponentially(defect, chamber):
    plant = held_plant()
    plant.defects = Defects(**{defect: LEAK})
    end = plant.step(PlantInput(0.0), 20_000)  # 1 s
    volume = plant.parameters.V_A0 if chamber == "P_A" else plant.parameters.V_B0
    expected = 50e5 * math.exp(-LEAK * plant.parameters.E / volume)
    assert getattr(end, chamber) == pytest.approx(expected, rel=1e-5)
    other = end.P_B if chamber == "P_A" else end.P_A
    assert other == pytest.approx(50e5, rel=1e-6)  # tanh lets the held piston creep by nm


def test_an_internal_leak_evens_the_chambers_out():
    """d(P_A - P_B)/dt = -C_L E (1 / V_A + 1 / V_B) (P_A - P_B)."""
    plant = held_plant()
    plant.restart(plant.state._replace(P_A=60e5, P_B=40e5))
    plant.defects = Defects(internal_leakage=LEAK)
    end = plant.step(PlantInput(0.0), 20_000)
    p = plant.parameters
    rate = LEAK * p.E * (1.0 / p.V_A0 + 1.0 / p.V_B0)
    assert end.P_A - end.P_B == pytest.approx(20e5 * math.exp(-rate), rel=1e-5)


def test_air_softens_the_oil_by_the_mixture_law():
    plant = held_plant()
    plant.defects = Defects(leakage_a=LEAK, entrained_air=0.3)
    end = plant.step(PlantInput(0.0), 20)  # 1 ms, in which the pressure falls by 0.002 %
    air = EntrainedAir(air_fraction=0.3)
    E = bulk_modulus(50e5, plant.parameters.E, (air.ratio, 1.4))
    assert E < 0.8 * plant.parameters.E
    expected = LEAK * 50e5 * E / plant.parameters.V_A0 * 1e-3
    assert 50e5 - end.P_A == pytest.approx(expected, rel=1e-3)


def test_a_worn_spool_leaks_as_an_orifice_in_its_centre():
    """Q = K x_0² / (x_0 + beta) (sqrt(P_S - P_A) - sqrt(P_A - P_T)), Eryilmaz and Wilson."""
    plant = held_plant()
    plant.restart(plant.state._replace(P_A=30e5, P_B=30e5))
    plant.defects = Defects(null_opening=40e-6)
    p = plant.parameters
    opening = (40e-6) ** 2 / (40e-6 + p.beta)
    flow = p.K * opening * (math.sqrt(p.P_S - 30e5) - math.sqrt(30e5))
    assert plant.step(PlantInput(0.0), 1).Q_A == pytest.approx(flow, rel=1e-3)
    plant.defects = Defects()
    assert plant.step(PlantInput(0.0), 1).Q_A == 0.0


def test_a_plant_whose_defects_are_mended_goes_on_as_one_without():
    sound, mended = FullOrderPlant(paper_parameters()), FullOrderPlant(paper_parameters())
    mended.defects = Defects(leakage_a=LEAK)
    mended.defects = Defects()
    for opening in (1e-3, -0.7e-3, 0.0):
        assert sound.step(PlantInput(opening), 2000) == mended.step(PlantInput(opening), 2000)


def test_a_supply_that_is_held_stays_held_while_something_breaks():
    plant = FullOrderPlant(paper_parameters())
    plant.supply_pressure = 40e5
    plant.defects = Defects(leakage_b=LEAK)
    assert plant.supply_pressure == 40e5
    plant.defects = Defects(internal_leakage=LEAK)
    assert plant.supply_pressure == 40e5


def test_a_leak_grows_from_tick_to_tick_and_ends():
    with bench_of() as bench:
        fault = bench.faults.leak("axis1", 4e-12, "a", growth=0.004)
        grown = []
        for _ in range(6):
            bench.run(0.001)
            grown.append(plant_of(bench).defects.leakage_a)
        assert grown == pytest.approx([0.0, 1e-12, 2e-12, 3e-12, 4e-12, 4e-12])
        fault.clear()
        bench.run(0.001)
        assert plant_of(bench).defects == Defects()


def test_leaks_add_up_and_end_each_by_itself():
    with bench_of() as bench:
        bench.faults.leak("axis1", 1e-12)
        second = bench.faults.leak("axis1", 2e-12)
        bench.run(0.002)
        assert plant_of(bench).defects.internal_leakage == pytest.approx(3e-12)
        second.clear()
        bench.run(0.001)
        assert plant_of(bench).defects.internal_leakage == pytest.approx(1e-12)


def test_a_jammed_axis_moves_as_one_with_that_friction():
    with bench_of() as bench:
        bench.faults.jam("axis1", 10_000.0)
        speed = opened(bench, 0.6)
        p = replace(paper_parameters(), F_c=10_600.0, F_s=10_900.0)
        z = 0.6 * p.full_opening - p.beta
        expected = steady_motion(p, PlantOptions.bench(), extends=True, z=z).speed
        assert speed == pytest.approx(expected, rel=1e-3)
        sound = steady_motion(paper_parameters(), PlantOptions.bench(), extends=True, z=z).speed
        assert expected < 0.95 * sound


def test_a_load_that_falls_off_leaves_the_oil_balanced_without_it():
    with bench_of(load_mass_kg=1000, load_slope_deg=90) as bench:
        p = plant_of(bench).parameters
        before = plant_of(bench).output
        weight = 1000 * 9.80665
        assert before.P_A * p.A_A - before.P_B * p.A_B == pytest.approx(weight, rel=1e-9)
        bench.faults.drop_load("axis1")
        bench.run(1.5)
        after = plant_of(bench).output
        # At rest no more than the static friction is left.
        assert abs(after.P_A * p.A_A - after.P_B * p.A_B) < p.F_s
        assert after.x > before.x


def test_a_worn_pump_leaves_its_share_of_the_speed():
    unit = {"supply": "unit", "pump_flow_l_min": 30, "accumulator_volume_l": 0}
    with bench_of(**unit) as bench:
        bench.faults.wear_pump("axis1", 0.4)
        speed = opened(bench, 1.0)
        # 18 of 30 l/min into 50 cm²
        assert speed == pytest.approx(18e-3 / 60 / 50e-4, rel=0.01)


def test_a_relief_valve_that_sags_holds_less():
    with bench_of(supply="unit") as bench:
        bench.faults.sag_relief("axis1", 50e5)
        bench.run(2.0)
        # P_R + Q / G with 60 l/min over 12 l/min a bar
        assert plant_of(bench).supply_pressure == pytest.approx(55e5, rel=1e-3)


def test_without_its_gas_the_accumulator_is_a_stiff_line():
    keys = {"supply": "unit", "supply_pressure_bar": 60, "accumulator_precharge_bar": 20}
    with bench_of(**keys) as bench:
        bench.faults.lose_gas("axis1")
        before = plant_of(bench).supply_pressure
        bench.run(0.001)
        # Q dt E / V = 1e-3 m³/s 1 ms 1e8 Pa / 5e-4 m³, 2 bar; the gas would let it rise by 0.01.
        assert plant_of(bench).supply_pressure - before == pytest.approx(2e5, rel=1e-3)


def test_a_spool_that_binds_moves_only_when_it_is_far_off():
    with bench_of() as bench:
        bench.faults.bind("valve", 0.2)
        assert opened(bench, 0.1) == pytest.approx(0.0, abs=1e-6)
        assert plant_of(bench).output.nu == pytest.approx(0.0, abs=1e-9)
    with bench_of() as bench:
        bench.faults.bind("valve", 0.2)
        opened(bench, 0.3)
        assert plant_of(bench).output.nu == pytest.approx(0.3 * 1.3e-3, rel=1e-3)


@pytest.mark.parametrize(("travel", "reached"), [(0.5, 0.5), (0.0, 0.0), (1.0, 0.8)])
def test_a_weak_solenoid_reaches_a_share_of_the_stroke(travel, reached):
    with bench_of() as bench:
        bench.faults.weaken("valve", travel)
        opened(bench, 0.8)
        assert plant_of(bench).output.nu == pytest.approx(reached * 1.3e-3, abs=1e-7)  # 1/16384


@pytest.mark.parametrize(
    ("begin", "said"),
    [
        (lambda f: f.drop_load("axis1"), "axis1 has no load to lose; give it load_n"),
        (lambda f: f.wear_pump("axis1", 0.5), "axis1 has no supply unit of its own; give it sup"),
        (lambda f: f.lose_gas("axis1"), "axis1 has no supply unit of its own"),
        (lambda f: f.leak("axis1", 1.0), "leak = 1 is out of range; give a number from 0 to 8.3"),
        (lambda f: f.leak("axis1", -1e-12), "leak = -1e-12 is out of range"),
        (lambda f: f.leak("axis1", math.nan), "leak = nan is out of range"),
        (lambda f: f.leak("axis1", 1e-12, "c"), 'path = "c" is unknown; give one of "internal"'),
        (lambda f: f.leak("axis2", 1e-12), 'there is no axis "axis2"; give one of axis1'),
        (lambda f: f.jam("axis1", 1.0, growth=-1.0), "growth = -1 is out of range"),
        (lambda f: f.weaken("valve", 1.5), "travel = 1.5 is out of range; give a number from 0"),
        (lambda f: f.bind("pressure_a", 0.1), 'there is no valve "pressure_a"'),
    ],
)
def test_what_makes_no_sense_is_refused(begin, said):
    with bench_of() as bench, pytest.raises(ConfigError) as error:
        begin(bench.faults)
    assert str(error.value).startswith(f"faults: {said}")


@pytest.mark.parametrize(
    ("keys", "fault", "said"),
    [
        (
            {"model": "reduced"},
            {"kind": "leak", "leak_l_min_bar": 0.1},
            "kind: axis1 cannot be worn: that takes a full-order cylinder",
        ),
        ({}, {"kind": "drop_load"}, "kind: axis1 has no load to lose"),
        ({}, {"kind": "jam"}, "force_n: missing; give for example force_n = 5000"),
        ({}, {"kind": "leak", "leak_l_min_bar": 9}, "leak_l_min_bar: 9 is out of range; give"),
    ],
)
def test_what_a_file_says_of_an_axis_is_checked(keys, fault, said):
    with pytest.raises(ConfigError) as error:
        load_config(tables={"plant": {"axis1": keys}, "faults": [{"target": "axis1", **fault}]})
    assert str(error.value).startswith(f"built-in bench:faults[1].{said}")


def test_a_page_offers_no_defect_that_a_plant_has_not_declared():
    with bench_of() as bench:
        declared = bench.faults.defects
        hello = {"fault_targets": bench.faults.targets, "channels": [], "defects": declared}
        assert "internal_leakage" in declared["axis1"]
        assert list(fault_choices(hello)["leak"]) == ["axis1"]
        hello["defects"] = {"axis1": ["dry_friction"]}
        choices = fault_choices(hello)
    assert list(choices["jam"]) == ["axis1"]
    assert choices["leak"] == choices["aerate"] == choices["drop_load"] == {}
    assert list(choices["stick"]) == ["valve"]


def test_a_page_offers_each_of_them_for_what_may_have_it():
    with bench_of() as bench:
        choices = fault_choices({"fault_targets": bench.faults.targets, "channels": []})
    assert list(choices["leak"]) == list(choices["drop_load"]) == ["axis1"]
    assert list(choices["bind"]) == list(choices["weaken"]) == ["valve"]
    (path,) = [key for key in choices["leak"]["axis1"] if key["name"] == "path"]
    assert path["choices"] == ["internal", "a", "b"]
    with bench_of(model="reduced") as bench:
        assert bench.faults.targets["plants"] == []
