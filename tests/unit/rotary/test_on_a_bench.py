"""A motor on a bench: recorded, measured by a driver, loaded and broken from outside."""

import math

import numpy as np
import pytest
from support.motors import LOSSLESS, VALVE, write_bench

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_bench.plants.rotary.kind import HydraulicMotor
from hil_drivers import Network, ProportionalValve, RotarySensor

NODES = f"""{VALVE}
[nodes.encoder]
profile = "rotary_encoder_406"
node_id = 4
"""
ANGLE, SPEED, P_A, P_B = range(4)


def test_a_driver_follows_the_angle_over_all_turns(tmp_path):
    """Wide open, the lossless motor turns at 1e-3 sqrt(105 / 35) / 1e-5 = 173.2 rad/s."""
    path = write_bench(tmp_path, LOSSLESS | {"angle_deg": -90}, NODES)
    config = load_config(path)
    bench = build_bench(config)
    bench.start(0)
    with EmbeddedBus(bench.tick, config.tick_ns) as bus, Network(bus, clock=bus.now) as network:
        valve, shaft = ProportionalValve(network, node_id=1), RotarySensor(network, node_id=4)
        for device in (valve, shaft):
            device.setup(transmission_type=254, event_timer=0.01)
            network.start_node(device.node.id)
        network.pump_until(network.now() + 0.05)
        # The first angle is that of the encoder, which counts from 0 to 4096 revolutions.
        assert shaft.angle == pytest.approx(4095.75 * math.tau, abs=1e-4)
        valve.enable()
        until = network.now() + 3.0
        while network.now() < until:
            valve.spool_setpoint = 1.0
            network.pump_until(network.now() + 0.01)
            assert shaft.is_valid
            angle = shaft.angle
        (axis,) = bench.axes
        shown = axis.plant.output
        assert shown[ANGLE] > 200.0
        assert angle == pytest.approx(4096 * math.tau + shown[ANGLE], abs=2.5)  # 10 ms old
        assert shaft.speed == pytest.approx(173.205, abs=0.11)  # steps of 1 rpm
        assert shaft.reading.unit == "rad"


def test_goes_on_from_a_recorded_state(motor):
    axis, plant = motor(viscous_friction_n_m_s=1.0)
    plant.drive(0.4e-3, 3000)
    names = [q.name for q in axis.kind.quantities if q.output is not None]
    recorded = dict(zip(names, plant.output, strict=True))
    follower = HydraulicMotor(axis, 50e-6, recorded)
    assert follower.output == pytest.approx(plant.output, rel=1e-12, abs=1e-12)
    one, other = plant.drive(0.4e-3, 200), follower.drive(0.4e-3, 200)
    assert np.allclose(one, other, rtol=1e-3)  # the spool's speed is not recorded


def test_a_load_from_outside_and_a_lost_one(motor):
    _, plant = motor(load_torque_n_m=50.0)
    plant.influence("load", 100.0)
    # 50 + 100 N m of 210: sqrt((210 - 150) / 70) of the rated flow
    assert plant.drive(1e-3, 60_000)[SPEED] == pytest.approx(100.0 * math.sqrt(60 / 70), rel=1e-5)
    plant.influence("load", None)
    plant.influence("load_loss", 1.0)
    assert plant.drive(1e-3, 60_000)[SPEED] == pytest.approx(100.0 * math.sqrt(3.0), rel=1e-5)
    plant.influence("supply_pressure", 70e5)
    assert plant.drive(1e-3, 60_000)[SPEED] == pytest.approx(100.0, rel=1e-5)


def test_a_leak_takes_its_flow(motor):
    """All that the valve lets through at 100 N m, less 0.1 l/min a bar past the rotor."""
    _, plant = motor(load_torque_n_m=100.0)
    sound = plant.drive(1e-3, 60_000)[SPEED]
    plant.influence("internal_leakage", 0.1e-3 / 60.0 / 1e5)
    worn = plant.drive(1e-3, 60_000)
    leak = 0.1e-3 / 60.0 / 1e5 * (worn[P_A] - worn[P_B])
    assert (sound - worn[SPEED]) * 1e-5 == pytest.approx(leak, rel=1e-4)


def test_a_worn_friction_that_is_a_force_is_none_of_a_motor(motor):
    axis, _ = motor()
    assert {each.name for each in axis.defects} == {
        "internal_leakage",
        "leakage_a",
        "leakage_b",
        "entrained_air",
        "null_opening",
    }
