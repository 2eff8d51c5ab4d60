"""The position sensor: its set-up as a transcript, its steps, and the EDS of other makers."""

import pytest

from device_profiles import ENCODER_406
from hil_drivers import DeviceMismatchError, PositionSensor

MAPPING = [0x60040020, 0x60300110]


@pytest.fixture
def sensor(network):
    return PositionSensor(network, 4)


def steps_of(upload, position, speed):
    return [upload(4, "6005.01", position), upload(4, "6005.02", speed)]


def test_position_and_speed_come_in_the_devices_steps(
    sensor, network, bus, expected_protocol, set_up_tpdo, upload
):
    # 0x6005.01 = 5000 x 0.001 µm = 5 µm; 0x6005.02 = 10 x 0.01 mm/s = 0.1 mm/s.
    with expected_protocol(
        [*set_up_tpdo(4, 406, MAPPING), *steps_of(upload, "88.13.00.00", "0A.00.00.00")]
    ):
        sensor.setup()
    bus.play("184#18.FC.FF.FF.2C.01")  # -1000 steps, 300 steps
    network.pump()
    assert sensor.position == pytest.approx(-5e-3, rel=1e-12)
    assert sensor.speed == pytest.approx(30e-3, rel=1e-12)


def test_a_multi_sensor_position_in_another_order(
    network, bus, edit_eds, expected_protocol, set_up_tpdo, upload
):
    mapping = [0x60300110, 0x60200120]
    eds = edit_eds(ENCODER_406, {"1A00sub1": hex(mapping[0]), "1A00sub2": hex(mapping[1])})
    # Nor does the disabled TPDO2 with 0x6004 attract the driver.
    sensor = PositionSensor(network, 4, eds)
    with expected_protocol(
        [*set_up_tpdo(4, 406, mapping), *steps_of(upload, "E8.03.00.00", "0A.00.00.00")]
    ):
        sensor.setup()
    bus.play("184#2C.01.40.42.0F.00")  # speed 300, position 1 000 000 steps of 1 µm
    network.pump()
    assert sensor.position == pytest.approx(1.0, rel=1e-12)
    assert sensor.speed == pytest.approx(30e-3, rel=1e-12)


def test_a_sensor_without_speed_still_tells_the_position(
    network, bus, edit_eds, expected_protocol, set_up_tpdo, upload
):
    eds = edit_eds(ENCODER_406, {"1A00sub0": 1, "1A01sub0": 1})
    sensor = PositionSensor(network, 4, eds)
    with expected_protocol(
        [*set_up_tpdo(4, 406, MAPPING[:1]), upload(4, "6005.01", "E8.03.00.00")]
    ):
        sensor.setup()
    bus.play("184#01.00.00.00")
    network.pump()
    assert sensor.position == pytest.approx(1e-6)
    with pytest.raises(DeviceMismatchError, match=r"carries 0x6030\.01"):
        _ = sensor.speed


@pytest.mark.parametrize(
    ("position", "speed", "name"),
    [("00.00.00.00", "0A.00.00.00", "6005.01"), ("E8.03.00.00", "00.00.00.00", "6005.02")],
)
def test_a_step_of_nothing_is_refused(
    sensor, expected_protocol, set_up_tpdo, upload, position, speed, name
):
    steps = steps_of(upload, position, speed)[: 1 if name.endswith("1") else 2]
    with (
        expected_protocol([*set_up_tpdo(4, 406, MAPPING), *steps]),
        pytest.raises(DeviceMismatchError, match=rf"0x{name} \(measuring step\) is 0"),
    ):
        sensor.setup()


def test_an_eds_without_position_is_refused(network, edit_eds):
    eds = edit_eds(ENCODER_406, {"1A00sub1": "0x60300110", "1A00sub0": 1, "1A01sub0": 0})
    with pytest.raises(DeviceMismatchError, match=r"carries 0x6004 or 0x6020\.01"):
        PositionSensor(network, 4, eds)
