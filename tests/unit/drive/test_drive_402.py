"""A drive of CiA 402 turns a hydraulic motor, commanded by SDO as any master would.

65536 increments are a revolution. The motor is that of docs/rotary.md without its load; 10 rev/s
are well below its top speed.
"""

import pytest

from device_profiles import DRIVE_402
from hil_bench import ConfigError, VirtualBench
from hil_drivers import Network, SdoAbortError

BENCH = """\
[plant.axis1]
kind = "rotary"
displacement_cm3_rev = 28
inertia_kg_m2 = 0.05
rated_speed_rpm = 1500
rated_pressure_bar = 200
volumetric_efficiency_percent = 96
hydromechanical_efficiency_percent = 93
rated_flow_l_min = 60
rated_pressure_drop_bar = 35
overlap_percent = 0
frequency_90deg_hz = 80
oil = "HLP 46"
supply_pressure_bar = 210

[nodes]
drive = { profile = "drive_402", node_id = 1 }
"""
REVOLUTION = 65536
ENABLED, FAULT, REACHED, ACKNOWLEDGED = 0x27, 0x08, 1 << 10, 1 << 12
STATE = 0x6F


class Master:
    def __init__(self, bench, network):
        self.bench, self.network = bench, network
        network.pump(0.01)
        self.node = network.add_node(1, DRIVE_402)
        network.start_node(1)
        network.pump(0.01)

    def enable(self, mode):
        self.node.write(0x6060, 0, mode)
        self.word(0x06, 0x07, 0x0F)

    def word(self, *words):
        for word in words:
            self.node.write(0x6040, 0, word)
            self.network.pump(0.003)

    def get(self, index):
        return self.node.read_integer(index, 0)

    def wait(self, seconds):
        self.network.pump(seconds)

    @property
    def status(self):
        return self.get(0x6041)

    @property
    def state(self):
        return self.status & STATE


@pytest.fixture
def config(load_bench):
    return load_bench(BENCH)


@pytest.fixture
def master(config):
    with VirtualBench(config) as bench, Network(bench.bus, clock=bench.now) as network:
        yield Master(bench, network)


@pytest.mark.parametrize("mode", [3, 9])
def test_a_velocity_is_reached_and_left(master, mode):
    master.enable(mode)
    assert master.state == ENABLED
    assert master.get(0x6061) == mode
    master.node.write(0x60FF, 0, 10 * REVOLUTION)
    master.wait(4.0)
    assert master.get(0x606C) == pytest.approx(10 * REVOLUTION, rel=0.02)
    truth = master.bench.signals["axis1.speed"][-1] / 6.283185307179586 * REVOLUTION
    assert master.get(0x606C) == pytest.approx(truth, rel=0.01)
    if mode == 3:
        assert master.status & REACHED
        master.word(0x10F)  # halt
        master.wait(3.0)
        assert abs(master.get(0x606C)) < 0.02 * 10 * REVOLUTION


def test_a_set_point_is_acknowledged_and_reached(master):
    master.enable(1)
    start = master.get(0x6064)
    master.node.write(0x607A, 0, start + 5 * REVOLUTION)
    master.word(0x1F)
    assert master.status & ACKNOWLEDGED
    assert not master.status & REACHED
    master.word(0x0F)
    assert not master.status & ACKNOWLEDGED
    master.wait(5.0)
    assert master.status & REACHED
    assert master.get(0x6064) - start == pytest.approx(5 * REVOLUTION, abs=656)


def test_a_second_set_point_waits_and_a_third_is_not_acknowledged(master):
    master.enable(1)
    start = master.get(0x6064)
    for turns, acknowledged in ((2, True), (4, True), (6, False)):
        master.node.write(0x607A, 0, start + turns * REVOLUTION)
        master.word(0x1F)
        assert bool(master.status & ACKNOWLEDGED) is acknowledged
        master.word(0x0F)
    master.wait(6.0)
    assert master.get(0x6064) - start == pytest.approx(4 * REVOLUTION, abs=656)


def test_a_relative_set_point_counts_from_the_last(master):
    master.enable(1)
    start = master.get(0x6064)
    master.node.write(0x607A, 0, REVOLUTION)
    master.word(0x5F, 0x0F)
    master.wait(4.0)
    assert master.get(0x6064) - start == pytest.approx(REVOLUTION, abs=656)


def test_cyclic_positions_are_followed(master):
    master.enable(8)
    start = master.get(0x6064)
    for step in range(1, 201):  # 2 rev/s for 2 s, a target each 10 ms
        master.node.write(0x607A, 0, start + step * REVOLUTION // 50)
        master.wait(0.009)
    assert master.get(0x606C) == pytest.approx(2 * REVOLUTION, rel=0.25)
    assert abs(master.get(0x60F4)) < 0.5 * REVOLUTION
    assert master.state == ENABLED


def test_a_following_error_is_a_fault_that_a_reset_ends(master):
    master.node.write(0x6065, 0, 1000)
    master.enable(1)
    master.node.write(0x607A, 0, master.get(0x6064) + 50 * REVOLUTION)
    master.word(0x1F)
    master.wait(3.0)
    assert master.state == FAULT
    assert master.get(0x603F) == 0x8611
    master.word(0x00, 0x80)
    assert master.state == 0x40
    assert master.get(0x603F) == 0


def test_leaving_operational_while_enabled_is_a_fault(master):
    master.enable(3)
    master.node.write(0x60FF, 0, 10 * REVOLUTION)
    master.wait(3.0)
    master.network.send(0x000, b"\x80\x01")
    master.wait(3.0)
    assert master.state == FAULT
    assert abs(master.get(0x606C)) < REVOLUTION


def test_without_operational_it_is_not_enabled(master):
    master.network.send(0x000, b"\x80\x01")
    master.wait(0.01)
    master.enable(3)
    assert master.state == 0x23


HOMING_BITS = 0x3400
"""Bits 13, 12 and 10, in which masters read how homing goes (`homing`)."""


def turned(master):
    """Turn two revolutions away, and leave the drive enabled in mode 6."""
    master.enable(1)
    master.node.write(0x607A, 0, master.get(0x6064) + 2 * REVOLUTION)
    master.word(0x1F, 0x0F)
    master.wait(3.5)
    master.node.write(0x6060, 0, 6)
    master.wait(0.01)
    assert master.status & HOMING_BITS == 0x0400  # not started


def test_homing_makes_the_present_position_zero(master):
    turned(master)
    before = master.get(0x6064)
    master.word(0x1F)
    assert master.status & HOMING_BITS == 0x1400  # attained, target reached
    assert before > 1.9 * REVOLUTION
    assert abs(master.get(0x6064)) < 0.01 * REVOLUTION
    master.word(0x0F)
    assert master.status & HOMING_BITS == 0x1400
    master.node.write(0x6060, 0, 1)
    master.node.write(0x607A, 0, REVOLUTION)
    master.word(0x1F)
    master.wait(3.5)
    turned_since = master.bench.signals["axis1.angle"][-1] / 6.283185307179586 * REVOLUTION - before
    assert turned_since == pytest.approx(REVOLUTION, abs=1500)
    assert master.state == ENABLED


def test_homing_waits_until_the_axis_stands(master):
    master.enable(3)
    master.node.write(0x60FF, 0, 10 * REVOLUTION)
    master.wait(3.5)
    master.node.write(0x6060, 0, 6)
    master.node.write(0x6098, 0, 35)
    master.word(0x1F)
    assert master.status & HOMING_BITS == 0  # under way
    master.wait(3.5)
    assert master.status & HOMING_BITS == 0x1400
    assert abs(master.get(0x6064)) < 0.1 * REVOLUTION


def test_homing_is_interrupted_by_bit_4(master):
    master.enable(3)
    master.node.write(0x60FF, 0, 10 * REVOLUTION)
    master.wait(3.5)
    master.node.write(0x6060, 0, 6)
    master.word(0x1F, 0x0F)
    master.wait(3.5)
    assert master.status & HOMING_BITS == 0x0400
    assert master.get(0x6064) > 10 * REVOLUTION


def test_a_reset_forgets_the_home_position(master):
    turned(master)
    before = master.get(0x6064)
    master.word(0x1F)
    master.network.send(0x000, b"\x81\x01")
    master.wait(0.5)
    assert master.get(0x6064) == pytest.approx(before, abs=0.05 * REVOLUTION)


@pytest.mark.parametrize(("index", "value"), [(0x6060, 4), (0x6083, 0), (0x6098, 17)])
def test_what_cannot_be_is_refused(master, index, value):
    with pytest.raises(SdoAbortError):
        master.node.write(index, 0, value)


def test_a_cylinder_has_no_place_for_it(load_bench):
    with pytest.raises(ConfigError, match="has no angle"):
        load_bench('[nodes.drive]\nprofile = "drive_402"\nnode_id = 1\n')
