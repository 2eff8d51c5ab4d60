"""The pressure transducer: its set-up as a transcript, its units, formats and states."""

import math
import struct

import pytest

from device_profiles import PRESSURE_404
from hil_drivers import DeviceMismatchError, PressureSensor, StaleValueError

MAPPING = [0x61300120, 0x61500108]


@pytest.fixture
def sensor(network):
    return PressureSensor(network, 2)


@pytest.fixture
def ready(sensor, expected_protocol, set_up_tpdo, upload):
    """A sensor that was set up; its device reports bar (0x004E0000)."""
    with expected_protocol([*set_up_tpdo(2, 404, MAPPING), upload(2, "6131.01", "00.00.4E.00")]):
        sensor.setup()
    return sensor


def real(value):
    return struct.pack("<f", value).hex()


def test_a_real_process_value_in_bar(ready, network, bus):
    bus.play(f"182#{real(2.5)}00")
    network.pump()
    assert ready.is_valid
    assert ready.pressure == 250_000.0


@pytest.mark.parametrize(
    ("unit", "pascal"),
    [
        # CiA 303-2: prefix exponent, numerator, denominator, reserved; most significant byte first.
        ("00.00.22.00", 1.0),  # Pa
        ("00.00.22.03", 1e3),  # kPa
        ("00.00.4E.00", 1e5),  # bar
        ("00.00.4E.FD", 1e2),  # mbar
        ("00.00.AB.00", 4.4482216152605 / 0.0254**2),  # psi: lbf over square inch, both exact
    ],
)
def test_units(sensor, bus, expected_protocol, set_up_tpdo, upload, unit, pascal):
    with expected_protocol([*set_up_tpdo(2, 404, MAPPING), upload(2, "6131.01", unit)]):
        sensor.setup()
    bus.play(f"182#{real(2.0)}00")
    sensor.network.pump()
    assert sensor.pressure == pytest.approx(2 * pascal, rel=1e-12)


# °C; bar per something; bar with 10 to the power of 10, and of -10
@pytest.mark.parametrize("unit", ["00.00.2D.00", "00.03.4E.00", "00.00.4E.0A", "00.00.4E.F6"])
def test_a_unit_that_is_no_pressure_is_refused(
    sensor, expected_protocol, set_up_tpdo, upload, unit
):
    with (
        expected_protocol([*set_up_tpdo(2, 404, MAPPING), upload(2, "6131.01", unit)]),
        pytest.raises(DeviceMismatchError, match=r"0x6131\.01 \(physical unit\)"),
    ):
        sensor.setup()


@pytest.mark.parametrize("frame", [f"182#{real(2.5)}01", f"182#{real(math.nan)}00"])
def test_what_the_device_calls_invalid_is_no_number(ready, network, bus, frame):
    bus.play(frame)
    network.pump()
    assert not ready.is_valid
    assert math.isnan(ready.pressure)


@pytest.mark.parametrize("status", ["02", "04"])
def test_an_overload_alone_leaves_the_value_valid(ready, network, bus, status):
    bus.play(f"182#{real(2.5)}{status}")
    network.pump()
    assert ready.is_valid


def test_no_value_before_the_first(ready):
    assert ready.age == math.inf
    with pytest.raises(StaleValueError, match=r"node 2: TPDO1 \(COB-ID 0x182\) never came"):
        _ = ready.pressure


def test_an_old_value_is_never_shown_again(ready, network, bus):
    bus.play(f"182#{real(2.5)}00")
    network.pump(0.1)
    assert ready.age == pytest.approx(0.1)
    assert ready.pressure == 250_000.0  # max_age is 0.1 s
    network.pump(0.01)
    with pytest.raises(StaleValueError, match=r"came 110\.0 ms ago; at most 100 ms are right"):
        _ = ready.pressure
    with pytest.raises(StaleValueError):
        _ = ready.is_valid


@pytest.mark.parametrize("frame", ["182#", "182#0000204000FF", "182#00002040", "182#R"])
def test_a_frame_of_another_length_is_no_value(ready, network, bus, frame):
    bus.play(frame)
    network.pump()
    with pytest.raises(StaleValueError, match="never came"):
        _ = ready.pressure


def test_an_integer_process_value_has_decimal_digits(
    network, bus, edit_eds, expected_protocol, set_up_tpdo, upload
):
    mapping = [0x71300110, 0x61500108]
    eds = edit_eds(PRESSURE_404, {"1A00sub1": hex(mapping[0])})
    sensor = PressureSensor(network, 2, eds)
    steps = [upload(2, "6131.01", "00.00.4E.00"), upload(2, "6132.01", "02")]
    with expected_protocol([*set_up_tpdo(2, 404, mapping), *steps]):
        sensor.setup()
    bus.play("182#D2.04.00")  # 0x04D2 = 1234, two digits after the point: 12.34 bar
    network.pump()
    assert sensor.pressure == pytest.approx(1_234_000.0, rel=1e-12)
    bus.play("182#00.80.00")  # the smallest integer stands for no value (WIKA MH-4-CAN manual)
    network.pump()
    assert not sensor.is_valid


@pytest.mark.parametrize("digits", ["0A", "FF"])  # 2^31 has ten digits, so one before the point
def test_decimal_digits_that_no_integer_has_are_refused(
    network, edit_eds, expected_protocol, set_up_tpdo, upload, digits
):
    mapping = [0x71300110, 0x61500108]
    sensor = PressureSensor(network, 2, edit_eds(PRESSURE_404, {"1A00sub1": hex(mapping[0])}))
    steps = [upload(2, "6131.01", "00.00.4E.00"), upload(2, "6132.01", digits)]
    with (
        expected_protocol([*set_up_tpdo(2, 404, mapping), *steps]),
        pytest.raises(
            DeviceMismatchError, match=r"0x6132\.01 \(decimal digits\) is (10|255); 0 to 9"
        ),
    ):
        sensor.setup()


def test_a_value_without_status_is_valid(
    network, bus, edit_eds, expected_protocol, set_up_tpdo, upload
):
    eds = edit_eds(PRESSURE_404, {"1A00sub0": 1})
    sensor = PressureSensor(network, 2, eds)
    with expected_protocol(
        [*set_up_tpdo(2, 404, MAPPING[:1]), upload(2, "6131.01", "00.00.4E.00")]
    ):
        sensor.setup()
    bus.play(f"182#{real(2.5)}")
    network.pump()
    assert sensor.is_valid


def test_two_channels_of_one_device_share_node_and_tpdo(network, bus, edit_eds):
    eds = edit_eds(PRESSURE_404, {"1A00sub2": "0x61300220"})
    first, second = (PressureSensor(network, 2, eds, channel=channel) for channel in (1, 2))
    assert first.node is second.node
    for sensor in (first, second):
        network.subscribe(0x182, sensor._received[0].receive)
        sensor._pascal_per_digit = 1.0
    bus.play(f"182#{real(1.0)}{real(2.0)}")
    network.pump()
    assert (first.pressure, second.pressure) == (1.0, 2.0)


def test_an_eds_without_process_value_is_refused(network, edit_eds):
    eds = edit_eds(PRESSURE_404, {"1A00sub1": "0x61500108", "1A00sub0": 1})
    with pytest.raises(DeviceMismatchError, match=r"no TPDO .* carries 0x6130\.01 or 0x9130\.01"):
        PressureSensor(network, 2, eds)
