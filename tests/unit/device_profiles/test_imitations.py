"""Devices of other kinds than our own, behind the drivers as they are: an EDS file and TOML."""

import contextlib
from pathlib import Path

import can
import pytest

from device_profiles import ENCODER_406, IMITATIONS, PRESSURE_404
from hil_bench.bench.assembly import embedded_bus
from hil_bench.bench.configuration import load_config
from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve, ValveState

EXAMPLE = Path(__file__).parents[3] / "examples" / "imitated_devices.toml"
VALVE = IMITATIONS / "valve_pdo4.eds"
ENCODER = IMITATIONS / "encoder_multi_sensor.eds"
PRESSURE_INT32 = IMITATIONS / "pressure_int32.eds"
PRESSURE_INT16 = IMITATIONS / "pressure_int16_status.eds"

BENCH = f"""
[plant.axis1]
position_mm = 30.0
[nodes.valve]
profile = "valve_408"
node_id = 127
eds = "{VALVE}"
[nodes.p]
profile = "pressure_404"
node_id = 2
source = "P_A"
eds = "{{pressure}}"
[nodes.p_reference]
profile = "pressure_404"
node_id = 3
source = "P_A"
[nodes.x]
profile = "encoder_406"
node_id = 4
eds = "{ENCODER}"
[nodes.x_reference]
profile = "encoder_406"
node_id = 5
{{more}}
"""


@pytest.fixture
def connect(tmp_path):
    """Open a bus with a bench on it; gives a network of drivers in virtual time, and the bus."""
    with contextlib.ExitStack() as stack:

        def connect(pressure=PRESSURE_INT32, more=""):
            path = tmp_path / "bench.toml"
            path.write_text(BENCH.format(pressure=pressure, more=more), encoding="utf-8")
            return open_network(path)

        def open_network(path):
            bus = stack.enter_context(embedded_bus(load_config(path)))
            return stack.enter_context(Network(bus, clock=bus.now)), bus

        connect.open = open_network
        yield connect


def sample(network, *devices):
    """Send SYNC, and wait until each device has answered."""
    since = network.now()
    network.sync()
    for device in devices:
        network.wait_until(lambda device=device: device.received_at > since, 1.0, "an answer")


def test_the_valve_with_set_point_in_pdo_4(connect):
    network, _ = connect()
    valve = ProportionalValve(network, 127, VALVE)
    position = PositionSensor(network, 5, ENCODER_406)
    valve.setup(command_timeout=0.1)
    position.setup()
    network.start_node()
    valve.enable()
    assert valve.read_state() is ValveState.ACTIVE
    for _ in range(50):
        valve.spool_setpoint = 0.5
        sample(network, valve, position)
    assert valve.state is ValveState.ACTIVE
    assert valve.spool_position == pytest.approx(0.5, abs=0.01)
    assert position.position > 0.03  # where it started
    valve.hold()
    assert valve.read_state() is ValveState.HOLD


def test_silence_on_rpdo_4_is_a_fault(connect):
    network, _ = connect()
    valve = ProportionalValve(network, 127, VALVE)
    valve.setup(command_timeout=0.05)
    network.start_node()
    valve.enable()
    network.pump(0.1)
    assert valve.read_state() is ValveState.FAULT_HOLD
    valve.reset_fault()
    valve.enable()


@pytest.mark.parametrize(
    ("eds", "resolution"),
    # 0x6132.01: three digits of a bar, one digit.
    [(PRESSURE_INT32, 100.0), (PRESSURE_INT16, 10000.0)],
)
def test_a_pressure_as_an_integer(connect, eds, resolution):
    network, _ = connect(eds)
    sensor = PressureSensor(network, 2, eds)
    reference = PressureSensor(network, 3, PRESSURE_404)
    for device in (sensor, reference):
        device.setup()
    network.start_node()
    sample(network, sensor, reference)
    assert sensor.is_valid
    assert reference.pressure > 1e6  # the cylinder is under pressure
    assert abs(sensor.pressure - reference.pressure) <= resolution / 2 * 1.001


@pytest.mark.parametrize("eds", [PRESSURE_INT32, PRESSURE_INT16])
def test_an_overload_is_told_by_the_integer_alone(connect, eds):
    network, _ = connect(
        eds,
        'objects = {}\n[nodes.low]\nprofile = "pressure_404"\nnode_id = 6\n'
        f'source = "P_A"\nspan_bar = [0.0, 1.0]\neds = "{eds}"',
    )
    sensor = PressureSensor(network, 6, eds)
    sensor.setup()
    network.start_node()
    sample(network, sensor)
    assert not sensor.is_valid


def test_the_encoder_of_the_multi_sensor_kind(connect):
    network, _ = connect()
    encoder = PositionSensor(network, 4, ENCODER)
    reference = PositionSensor(network, 5, ENCODER_406)
    for device in (encoder, reference):
        device.setup()
    network.start_node()
    sample(network, encoder, reference)
    assert encoder.position == reference.position == pytest.approx(0.03)
    assert encoder.speed == reference.speed == 0.0


def test_the_encoder_sends_each_millisecond_without_being_told(connect):
    network, bus = connect()
    network.pump(0.01)  # the nodes boot
    bus.send(can.Message(arbitration_id=0, data=[1, 4], is_extended_id=False))
    end = bus.now() + 0.0505
    lengths = []
    while bus.now() < end:
        frame = bus.recv(0.001)
        if frame is not None and frame.arbitration_id == 0x184:
            lengths.append(frame.dlc)
    # Position, speed and area state: 4 + 2 + 1 bytes, about 50 times in 50 ms.
    assert 48 <= len(lengths) <= 51
    assert set(lengths) == {7}


def test_the_example(connect):
    network, _ = connect.open(EXAMPLE)
    valve = ProportionalValve(network, 127, VALVE)
    pressures = [
        PressureSensor(network, 2, PRESSURE_INT32),
        PressureSensor(network, 3, PRESSURE_INT16),
    ]
    position = PositionSensor(network, 4, ENCODER)
    for device in (valve, *pressures, position):
        device.setup()
    network.start_node()
    valve.enable()
    for _ in range(50):
        valve.spool_setpoint = -0.5
        sample(network, valve, position, *pressures)
    assert valve.spool_position == pytest.approx(-0.5, abs=0.01)
    assert position.position < -1e-3
    steps = position.position / 5e-6  # the step of the example
    assert steps == pytest.approx(round(steps), abs=1e-6)
    assert all(sensor.is_valid for sensor in pressures)
