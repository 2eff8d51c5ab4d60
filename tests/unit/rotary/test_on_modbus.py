"""A motor's bench on Modbus: the registers of its encoder, and a driver that reads them."""

import math

import pytest
from support.modbus_side import CONTROL, ENABLE, ModbusSide
from support.motors import LOSSLESS, VALVE, write_bench

from hil_bench import Faults, VirtualBench, load_config
from hil_bench.abilities.modbus.protocol.register_map import Table
from hil_drivers import modbus
from hil_drivers.modbus.framing import TcpFraming

ENCODER = 4
INPUTS, HOLDING = Table.INPUT_REGISTERS, Table.HOLDING_REGISTERS
TURN_STEPS, RANGE_STEPS = 65536, 65536 * 4096
PRESET, PARAMETERS, SCALED_TURN_STEPS = 0, 2, 3
NODES = f"""{VALVE}
[nodes.encoder]
profile = "rotary_encoder_406"
node_id = 4
[modbus.units.valve]
commands = true
[modbus.units.encoder]
"""


@pytest.fixture
def make_side(tmp_path):
    def make(angle_deg):
        keys = LOSSLESS | {"angle_deg": angle_deg}
        return ModbusSide(load_config(write_bench(tmp_path, keys, NODES)))

    return make


def shown(side, *names):
    return [side.read(ENCODER, INPUTS, name) for name in names]


@pytest.mark.parametrize(
    ("angle_deg", "steps", "degrees"),
    [
        (3 * 360 / TURN_STEPS, 3, 0.0164794921875),
        (90.0, TURN_STEPS // 4, 90.0),
        (540.0, TURN_STEPS * 3 // 2, 540.0),
        (-90.0, RANGE_STEPS - TURN_STEPS // 4, 4096 * 360.0 - 90.0),  # the last revolution
    ],
)
def test_an_angle_in_steps_and_degrees(make_side, angle_deg, steps, degrees):
    side = make_side(angle_deg)
    angle, scaled, position = shown(side, "angle", "angle_scaled", "position")
    assert position == steps
    assert angle == pytest.approx(degrees, rel=2**-24, abs=0.0)  # as a float32 rounds
    assert scaled == pytest.approx(degrees, abs=0.0005)
    assert shown(side, "turn_steps", "range_steps", "alarms") == [TURN_STEPS, RANGE_STEPS, 0]


def test_scaling_is_set_by_registers_and_changes_the_steps_alone(make_side):
    side = make_side(540.0)
    # Two of 16 bits each: 3600 steps a revolution over 10 of them.
    assert side.write(ENCODER, HOLDING, SCALED_TURN_STEPS, 0, 3600, 0, 36000) == 0
    side.tick(count=2)
    assert shown(side, "position", "turn_steps", "range_steps") == [5400, 3600, 36000]
    assert shown(side, "angle", "angle_scaled") == [540.0, pytest.approx(540.0, abs=1e-9)]
    assert side.write(ENCODER, HOLDING, PARAMETERS, 0) == 0
    side.tick(count=2)
    assert shown(side, "position", "angle") == [TURN_STEPS * 3 // 2, 540.0]
    assert shown(side, "turn_steps", "range_steps") == [TURN_STEPS, RANGE_STEPS]


def test_a_preset_and_the_direction_by_registers(make_side):
    side = make_side(90.0)
    assert side.write(ENCODER, HOLDING, PRESET, 1, 0) == 0  # 65536 steps
    side.tick(count=2)
    assert shown(side, "angle") == [360.0]
    assert side.write(ENCODER, HOLDING, PRESET, 0x1000, 0) == 3  # 268435456: the end of the range
    assert side.write(ENCODER, HOLDING, SCALED_TURN_STEPS, 0, 0) == 3
    assert side.write(ENCODER, HOLDING, PARAMETERS, 2) == 3


def test_a_broken_wire_is_no_valid_angle(make_side):
    side = make_side(90.0)
    assert side.read(ENCODER, Table.DISCRETE_INPUTS, "valid") == 1
    with side.bench.part(Faults).break_wire("encoder"):
        side.tick(count=2)
        assert side.read(ENCODER, Table.DISCRETE_INPUTS, "valid") == 0
        assert shown(side, "alarms", "position") == [1, TURN_STEPS // 4]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_speed_that_a_modbus_client_commands(make_side, direction):
    """Wide open: 1e-3 sqrt(105 / 35) / 1e-5 = 173.205 rad/s, which are 1653.99 rpm."""
    side = make_side(0.0)
    assert (side.coil(CONTROL, 1), side.coil(ENABLE, 1)) == (0, 0)
    for _ in range(500):
        assert side.setpoint(direction * 1.0) == 0
    assert shown(side, "speed", "speed_scaled") == [
        pytest.approx(direction * 1654.0, abs=1e-3),  # steps of 1 rpm
        direction * 1654,
    ]


def test_a_driver_follows_the_angle_past_the_end_of_the_range(tmp_path):
    path = write_bench(tmp_path, LOSSLESS | {"angle_deg": -90}, NODES)
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.005)
        client = modbus.ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now)
        valve, shaft = modbus.ProportionalValve(client, 1), modbus.RotarySensor(client, ENCODER)
        for device in (valve, shaft):
            device.setup()
        assert shaft.angle == pytest.approx(4095.75 * math.tau, abs=1e-4)
        valve.enable()
        until = bench.now() + 3.0
        while bench.now() < until:
            valve.spool_setpoint = 1.0
            shaft.poll()
            assert shaft.is_valid
            angle = shaft.angle
        assert bench.values["axis1.angle"] > 200.0
        turned = 4096 * math.tau + bench.values["axis1.angle"]
        assert angle == pytest.approx(turned, abs=1.0)  # a few ms old at 173 rad/s
        assert shaft.speed == pytest.approx(173.205, abs=0.11)  # steps of 1 rpm
        assert shaft.reading[:2] == (angle, "rad")
