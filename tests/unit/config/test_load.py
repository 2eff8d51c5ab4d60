"""What a file makes of a bench."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import pytest

import device_profiles
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import BusConfig, Origin, load_config
from hil_bench.devices.kinds.encoder_406 import EncoderConfig
from hil_bench.devices.kinds.pressure_404 import PressureConfig
from hil_bench.devices.kinds.valve_408 import ValveConfig
from hil_bench.plants.hydraulic_cylinder.model import Model, ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.extensions import EntrainedAir, LuGreFriction
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    LoadSeries,
    MassOnSlope,
    SpringLoad,
)
from hil_bench.plants.hydraulic_cylinder.model.options import EndStop, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver

Write = Callable[[str], Path]


def test_without_a_file_there_is_one_axis_with_table_1_and_four_nodes():
    config = load_config()

    assert config.path is None
    assert (config.tick_ns, config.step_ns, config.steps_per_tick) == (1_000_000, 50_000, 20)
    assert config.dt == pytest.approx(5e-5, rel=1e-15)
    assert config.seed == 1
    assert config.bus == BusConfig(None, None, None, {})
    (axis,) = config.axes
    assert axis.name == "axis1"
    assert axis.parameters == paper_parameters()
    assert axis.options == PlantOptions.bench()
    assert axis.solver is Solver.LINEARLY_IMPLICIT_MIDPOINT
    assert axis.position == 0.0
    names = [(node.name, node.node_id, node.axis) for node in config.nodes]
    assert names == [
        ("valve", 1, "axis1"),
        ("pressure_a", 2, "axis1"),
        ("pressure_b", 3, "axis1"),
        ("position", 4, "axis1"),
    ]
    assert {setting.origin for setting in config.settings} == {Origin.DEFAULT}


def test_the_default_nodes_are_one_of_each_device():
    valve, pressure_a, pressure_b, position = load_config().nodes

    assert isinstance(valve, ValveConfig)
    # alpha + beta of Table I: 1 mm + 0.3 mm.
    assert valve.full_opening == pytest.approx(1.3e-3, rel=1e-12)
    assert valve.eds == device_profiles.VALVE_408
    assert isinstance(pressure_a, PressureConfig)
    assert pressure_a.source == "P_A"
    assert pressure_a.span == (0.0, 250e5)
    assert pressure_a.eds == device_profiles.PRESSURE_404
    assert isinstance(pressure_b, PressureConfig)
    assert pressure_b.source == "P_B"
    assert isinstance(position, EncoderConfig)
    assert position.eds == device_profiles.ENCODER_406


def test_values_are_converted_to_si(write):
    path = write("""
        bench.step_us = 20
        [plant.lift]
        stroke_mm = 300
        supply_pressure_bar = 210
        bulk_modulus_mpa = 1200.0
        internal_leakage_l_min_bar = 0.006
        position_mm = -50
        end_stop_stiffness_n_mm = 1e5
        cavitation_floor_bar = -0.5
        solver = "forward-euler"
    """)
    (axis,) = load_config(path).axes

    expected = dataclasses.replace(
        paper_parameters(), h=0.15, P_S=21e6, E=1.2e9, C_L=axis.parameters.C_L
    )
    assert axis.parameters == expected
    assert axis.parameters.C_L == pytest.approx(1e-12)  # 0.006e-3 m³ / 60 s / 1e5 Pa
    assert axis.position == pytest.approx(-0.05)
    assert axis.options.end_stop == EndStop(stiffness=1e8, damping=2e4)
    assert axis.options.cavitation_floor == -50_000.0
    assert axis.solver is Solver.FORWARD_EULER


def test_a_bench_can_run_on_the_reduced_model(write):
    config = load_config(
        write("""
        [plant.axis1]
        model = "reduced"
        spool_delay_ms = 1.2
        position_mm = 20
        load_n = 970
    """)
    )
    assert config.axes[0].model is Model.REDUCED
    plant = build_bench(config).axes[0].plant
    assert isinstance(plant, ReducedOrderPlant)
    assert plant.delay == pytest.approx(1.2e-3)
    assert plant.state.x == pytest.approx(0.02)
    assert plant.state.P_A - plant.state.P_B == pytest.approx(970.0 / 4.85e-3)


def test_end_stop_and_cavitation_can_be_turned_off(write):
    path = write("""
        [plant.axis1]
        end_stop = false
        cavitation = false
        laminar_transition_pa = 0
    """)

    assert load_config(path).axes[0].options == PlantOptions.paper()


def test_extensions_of_the_plant_are_converted_to_si(write):
    path = write("""
        [plant.axis1]
        orifice_full_opening_negative_mm = 0.8
        spool_overlap_negative_mm = 0.6
        external_leakage_a_l_min_bar = 0.06
        external_leakage_b_l_min_bar = 0.12
        entrained_air_percent = 2
        entrained_air_exponent = 1.2
        friction = "lugre"
        bristle_stiffness_n_mm = 5000
        bristle_damping_n_s_m = 1500
        supply = "unit"
        pump_flow_l_min = 30
        relief_pressure_bar = 120
        relief_gradient_l_min_bar = 6
        supply_line_volume_cm3 = 250
        accumulator_volume_l = 2
        accumulator_precharge_bar = 80
        accumulator_exponent = 1.3
        load_n = -500
        load_spring_n_mm = 20
        load_spring_rest_mm = -50
        load_mass_kg = 100
        load_slope_deg = 30
        load_series_s_n = [[0, 0], [2.5, 400]]
    """)
    options = load_config(path).axes[0].options

    assert (options.alpha_negative, options.beta_negative) == pytest.approx((8e-4, 6e-4))
    assert (options.C_LA, options.C_LB) == pytest.approx((1e-11, 2e-11))
    assert options.air == EntrainedAir(air_fraction=0.02, air_exponent=1.2)
    assert options.bristles == LuGreFriction(sigma_0=5e6, sigma_1=1500.0)
    assert options.supply is not None
    assert dataclasses.astuple(options.supply) == pytest.approx(
        (5e-4, 1.2e7, 1e-9, 2.5e-4, 2e-3, 8e6, 1.3, None, None)
    )
    force, spring, mass, series = options.loads
    assert force == ConstantLoad(-500.0)
    assert isinstance(spring, SpringLoad)
    assert dataclasses.astuple(spring) == pytest.approx((2e4, -0.05))
    assert isinstance(mass, MassOnSlope)
    assert dataclasses.astuple(mass) == pytest.approx((100.0, math.pi / 6.0))
    assert series == LoadSeries((0.0, 2.5), (0.0, 400.0))


def test_an_extension_that_is_off_is_absent_whatever_its_other_keys_say(write):
    path = write("""
        [plant.axis1]
        entrained_air_exponent = 9
        bristle_stiffness_n_mm = -1
        pump_flow_l_min = -1
        load_spring_rest_mm = 20
        load_slope_deg = 30
    """)

    assert load_config(path).axes[0].options == PlantOptions.bench()


def test_the_full_opening_is_that_of_the_larger_side(write):
    text = """
        [plant.a]
        spool_overlap_negative_mm = 0.7
        [nodes.v]
        profile = "valve_408"
        node_id = 1
    """
    (valve,) = load_config(write(text)).nodes

    assert isinstance(valve, ValveConfig)
    assert valve.full_opening == pytest.approx(1.7e-3)  # 1 mm + 0.7 mm


def test_a_file_with_a_bus_alone_keeps_the_default_bench(write):
    config = load_config(write('[bus]\ninterface = "socketcan"\nchannel = "vcan0"\n'))

    assert config.bus == BusConfig("socketcan", "vcan0", None, {})
    assert config.axes == load_config().axes
    assert config.nodes == load_config().nodes


def test_the_default_nodes_belong_to_the_only_axis_whatever_its_name(write):
    config = load_config(write("[plant.lift]\n"))

    assert {node.axis for node in config.nodes} == {"lift"}


def test_a_relative_eds_path_is_relative_to_the_file(tmp_path):
    eds = tmp_path / "eds" / "my_valve.eds"
    eds.parent.mkdir()
    eds.touch()
    path = tmp_path / "bench.toml"
    path.write_text('[nodes.v]\nprofile = "valve_408"\nnode_id = 9\neds = "eds/my_valve.eds"\n')
    (valve,) = load_config(path).nodes

    assert valve.eds == eds


def test_the_full_opening_follows_the_valve_of_its_axis_unless_given(write):
    text = """
        [plant.a]
        orifice_full_opening_mm = 2
        [plant.b]
        [nodes.va]
        profile = "valve_408"
        axis = "a"
        node_id = 1
        [nodes.vb]
        profile = "valve_408"
        axis = "b"
        node_id = 2
        full_opening_mm = 1.1
    """
    openings = [node.full_opening for node in load_config(write(text)).nodes]

    assert openings == pytest.approx([2.3e-3, 1.1e-3])


def test_a_channel_may_be_a_number(write):
    assert load_config(write("[bus]\nchannel = 1\n")).bus.channel == 1


def test_further_keys_of_the_bus_become_options(write):
    text = '[bus]\ninterface = "socketcand"\nchannel = "can0"\nhost = "127.0.0.1"\nport = 29536\n'

    assert load_config(write(text)).bus.options == {"host": "127.0.0.1", "port": 29536}


def test_records_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_config().seed = 2


def test_a_node_without_node_id_may_have_a_serial_number(write):
    text = '[nodes.v]\nprofile = "valve_408"\nnode_id = "unconfigured"\nserial_number = 77\n'
    (valve,) = load_config(write(text)).nodes

    assert (valve.node_id, valve.serial_number) == (255, 77)


def test_a_relative_storage_folder_is_relative_to_the_file_and_may_be_new(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text('[nodes.v]\nprofile = "valve_408"\nnode_id = 9\nstorage = "new"\n')
    (valve,) = load_config(path).nodes

    assert valve.storage == tmp_path / "new"
    assert not valve.storage.exists()


def test_nodes_without_node_id_do_not_clash(write):
    node = '[nodes.n{0}]\nprofile = "{1}"\nnode_id = 255\nserial_number = {0}\n'
    text = node.format(1, "valve_408") + node.format(2, "encoder_406")

    assert [node.node_id for node in load_config(write(text)).nodes] == [255, 255]
