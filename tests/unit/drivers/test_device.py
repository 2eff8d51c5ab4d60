"""What all drivers check: identity, mapping, COB-IDs; and that they write only what differs."""

import math

import pytest

from device_profiles import ENCODER_406
from hil_drivers import (
    ControllerParameters,
    DeviceMismatchError,
    DriverTimeoutError,
    Network,
    PositionSensor,
    SdoAbortError,
    StaleValueError,
)
from hil_drivers.device import milliseconds
from hil_drivers.j1939 import J1939Device, J1939Port, Name
from hil_drivers.modbus import ModbusClient
from hil_drivers.modbus import PositionSensor as PositionOnModbus

MAPPING = [0x60040020, 0x60300110]


@pytest.fixture
def sensor(network):
    return PositionSensor(network, 4)


@pytest.fixture
def identity(upload):
    return [upload(4, "1000.00", "96.01.00.00"), upload(4, "1018.02", "06.04.00.00")]


@pytest.fixture
def mapping(upload):
    return [
        upload(4, "1A00.00", "02"),
        upload(4, "1A00.01", "20.00.04.60"),
        upload(4, "1A00.02", "10.01.30.60"),
    ]


def test_another_profile_is_refused(sensor, expected_protocol, upload):
    with (
        expected_protocol([upload(4, "1000.00", "98.01.00.00")]),
        pytest.raises(DeviceMismatchError, match=r"0x1000 \(device type\) says profile 408; 406"),
    ):
        sensor.setup()


def test_another_product_is_refused(sensor, expected_protocol, upload, identity):
    with (
        expected_protocol([identity[0], upload(4, "1018.02", "07.04.00.00")]),
        pytest.raises(DeviceMismatchError, match=r"0x1018\.02 .* is 0x407; 0x406 is right"),
    ):
        sensor.setup()


def test_the_vendor_counts_where_the_eds_names_one(
    network, edit_eds, expected_protocol, upload, identity
):
    sensor = PositionSensor(network, 4, edit_eds(ENCODER_406, {"1018sub1": "0x1F"}))
    with (
        expected_protocol([identity[0], upload(4, "1018.01", "2F.00.00.00")]),
        pytest.raises(DeviceMismatchError, match=r"0x1018\.01 .* is 0x2F; 0x1F is right"),
    ):
        sensor.setup()


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ([("1A00.00", "01")], r"0x1A00\.00 \(TPDO1\) maps 1 objects; 2 are right"),
        (
            [("1A00.00", "02"), ("1A00.01", "20.01.20.60")],
            r"0x1A00\.01 \(TPDO1\) maps 0x6020\.01 \(32 bit\); 0x6004 \(32 bit\) is right",
        ),
    ],
)
def test_another_mapping_is_refused(sensor, expected_protocol, upload, identity, answers, message):
    steps = [upload(4, name, raw) for name, raw in answers]
    with expected_protocol([*identity, *steps]), pytest.raises(DeviceMismatchError, match=message):
        sensor.setup()


def test_a_device_that_is_set_up_already_is_only_read(
    sensor, bus, expected_protocol, upload, download, identity, mapping
):
    steps = [
        *identity,
        *mapping,
        upload(4, "1800.01", "90.01.00.40"),  # another COB-ID than the EDS's: the device is right
        upload(4, "1800.02", "01"),
        upload(4, "1800.05", "00.00"),
        download(4, "1017.00", "64.00"),
        upload(4, "6005.01", "E8.03.00.00"),
        upload(4, "6005.02", "0A.00.00.00"),
    ]
    with expected_protocol(steps):
        sensor.setup()
    bus.play("190#01.00.00.00.00.00")
    sensor.network.pump()
    assert sensor.position == pytest.approx(1e-6)


def test_a_tpdo_that_exists_comes_before_one_to_be_enabled(network, edit_eds):
    # TPDO1 and TPDO2 carry the same; here it is TPDO1 that does not exist.
    eds = edit_eds(
        ENCODER_406, {"1800sub1": "$NODEID+0xC0000180", "1801sub1": "$NODEID+0x40000280"}
    )
    sensor = PositionSensor(network, 4, eds)
    assert [str(pdo.mapping) for pdo in sensor._received] == ["TPDO2"]


def test_a_disabled_tpdo_is_enabled(
    network, edit_eds, expected_protocol, upload, download, identity
):
    # Only TPDO2, which does not exist yet (bit 31 of its COB-ID), carries the position.
    eds = edit_eds(ENCODER_406, {"1A00sub0": 0})
    sensor = PositionSensor(network, 4, eds)
    steps = [
        *identity,
        upload(4, "1A01.00", "02"),
        upload(4, "1A01.01", "20.00.04.60"),
        upload(4, "1A01.02", "10.01.30.60"),
        upload(4, "1801.01", "84.02.00.C0"),
        upload(4, "1801.02", "01"),
        upload(4, "1801.05", "00.00"),
        download(4, "1801.01", "84.02.00.40"),
        download(4, "1017.00", "64.00"),
        upload(4, "6005.01", "E8.03.00.00"),
        upload(4, "6005.02", "0A.00.00.00"),
    ]
    with expected_protocol(steps):
        sensor.setup()


@pytest.mark.parametrize("cob_id", ["84.01.00.20", "00.00.00.80"])  # 29 bit; none
def test_a_tpdo_without_an_11_bit_identifier_is_refused(
    sensor, expected_protocol, upload, identity, mapping, cob_id
):
    with (
        expected_protocol([*identity, *mapping, upload(4, "1800.01", cob_id)]),
        pytest.raises(DeviceMismatchError, match="an 11-bit CAN identifier is right"),
    ):
        sensor.setup()


def test_a_refused_transmission_type_is_told(
    sensor, expected_protocol, upload, download, identity, mapping
):
    steps = [
        *identity,
        *mapping,
        upload(4, "1800.01", "84.01.00.40"),
        upload(4, "1800.02", "FF"),
        upload(4, "1800.05", "00.00"),
        download(4, "1800.01", "84.01.00.C0"),
        ("604#2F.00.18.02.01.00.00.00", "584#80.00.18.02.30.00.09.06"),
    ]
    with expected_protocol(steps), pytest.raises(SdoAbortError, match=r"0x1800\.02") as caught:
        sensor.setup()
    assert caught.value.code == 0x06090030


def test_a_time_is_whole_milliseconds_in_16_bits():
    expected = {0.0: 0, 0.000501: 1, 0.001: 1, 0.25: 250, 65.535: 65535}
    assert {time: milliseconds("event timer", time) for time in expected} == expected


def port(address):
    return J1939Port(Network(None), Name(1), address)


@pytest.mark.parametrize(
    ("make", "good", "bad"),
    [
        (lambda number: Network(None).add_node(number), [1, 127], [0, 128]),
        (lambda address: J1939Device(port(0), address), [0, 253], [-1, 254]),
        (port, [0, 253], [-1, 254]),
        (lambda unit: PositionOnModbus(ModbusClient(None), unit), [1, 247], [0, 248]),
        (lambda size: ControllerParameters(position_gain=size), [0.0], [-1e-9, math.inf]),
        (lambda size: ControllerParameters(dead_zone=size), [0.0, 0.999], [1.0]),
        (lambda size: ControllerParameters(full_speed=size), [1e-9], [0.0]),
        (lambda size: ControllerParameters(tolerance=size), [0.0], [-1e-9]),
    ],
)
def test_limits_are_met_exactly(make, good, bad):
    for value in good:
        make(value)
    for value in bad:
        with pytest.raises(ValueError, match="is right"):
            make(value)


@pytest.mark.parametrize("number", [0, 1, 240, 254, 255])
def test_transmission_types_of_cia_301_are_taken(sensor, bus, number):
    with pytest.raises(DriverTimeoutError):  # nobody answers
        sensor.setup(transmission_type=number)
    assert bus.sent


@pytest.mark.parametrize(
    "arguments",
    [
        {"transmission_type": 241},
        {"transmission_type": 253},
        {"transmission_type": 256},
        {"transmission_type": -1},
        {"event_timer": -0.1},
        {"event_timer": 65.536},
        {"heartbeat_period": 0.0005},  # 0 ms when rounded, which is no heartbeat
    ],
)
def test_an_argument_out_of_range_is_refused_before_anything_is_sent(sensor, bus, arguments):
    with pytest.raises(ValueError, match="is right"):
        sensor.setup(**arguments)
    assert bus.sent == []


def test_a_driver_that_was_not_set_up_has_no_value(sensor, network, bus):
    bus.play("184#01.00.00.00.00.00")
    network.pump()
    with pytest.raises(StaleValueError, match=r"setup\(\)"):
        _ = sensor.position


@pytest.mark.parametrize(
    ("defaults", "message"),
    [
        ({"1A00sub1": "0x60040010"}, "maps 16 bit of 0x6004"),  # half an INTEGER32
        ({"1A00sub1": "0x00010001", "1A00sub2": "0x60040020"}, "at bit 1"),  # behind one bit
    ],
)
def test_a_mapping_that_cuts_objects_is_refused(network, edit_eds, defaults, message):
    eds = edit_eds(ENCODER_406, {**defaults, "1A01sub0": 0})
    with pytest.raises(DeviceMismatchError, match=message):
        PositionSensor(network, 4, eds)
