"""The drivers against transcripts: other makers' maps, staleness, identity."""

import math
import re
import struct

import pytest

from device_profiles import REGISTERS
from hil_drivers import (
    DeviceFaultError,
    DeviceMismatchError,
    DriverTimeoutError,
    RegisterMapError,
    RemoteProtocolError,
    StaleValueError,
    ValveState,
)
from hil_drivers.modbus import PositionSensor, PressureSensor, ProportionalValve

HEAD = """
[device]
profile = "{profile}"
vendor_name = "maker"
product_code = "P-1"
revision = "2"
word_order = "little"
"""


def words(*values):
    return [word for value in values for word in struct.unpack(">2H", struct.pack(">f", value))]


def make_map(tmp_path, text, profile="pressure_404"):
    path = tmp_path / "map.toml"
    path.write_text(HEAD.format(profile=profile) + text)
    return path


# Float 50 bar is 42480000; the profile's own map: pressure, sample, status in five registers.
OWN = [*words(50.0), 0, 7, 0]


def test_a_pressure_in_si(client, answer):
    sensor = PressureSensor(client, 2)
    answer(OWN)
    assert sensor.poll() is True
    assert sensor.reading == (50e5, "Pa", 100.0, True)


def test_one_request_reads_value_sample_and_status(client, link, answer):
    sensor = PressureSensor(client, 2)
    answer(OWN)
    sensor.poll()
    assert [sent[7:] for sent in link.sent] == [bytes.fromhex("04 0000 0005")]


@pytest.mark.parametrize(("registers", "status"), [(words(math.nan), 1), (words(50.0), 1)])
def test_a_value_that_is_not_valid_is_nan_and_says_so(client, answer, registers, status):
    sensor = PressureSensor(client, 2)
    answer([*registers, 0, 7, status])
    sensor.poll()
    assert math.isnan(sensor.pressure)
    assert sensor.reading.is_valid is False


def test_another_makers_map(client, link, answer, tmp_path):
    path = make_map(
        tmp_path,
        '[input_registers.a]\naddress = 100\ntype = "int32"\nunit = "mbar"\nscale = 0.1\n'
        'source = "pressure"\n',
    )
    sensor = PressureSensor(client, 2, path)
    answer([0x1234, 0x0001])
    sensor.poll()
    # Low word first: 0x00011234 = 70196 times 0.1 mbar of 100 Pa.
    assert sensor.pressure == pytest.approx(70196 * 10.0)
    assert link.sent[0][7:] == bytes.fromhex("04 0064 0002")
    answer([0x0000, 0x8000])
    sensor.poll()
    assert not sensor.is_valid


def test_registers_apart_are_read_by_a_request_each(client, link, answer, tmp_path):
    path = make_map(
        tmp_path,
        '[input_registers.x]\naddress = 0\ntype = "int16"\nunit = "mm"\nsource = "position"\n'
        '[input_registers.v]\naddress = 9\ntype = "int16"\nunit = "mm/s"\nsource = "speed"\n',
        "encoder_406",
    )
    sensor = PositionSensor(client, 4, path)
    answer([0xFFFE], [100])
    sensor.poll()
    assert (sensor.position, sensor.speed) == (pytest.approx(-2e-3), pytest.approx(0.1))
    assert sensor.is_valid
    assert [sent[7:].hex() for sent in link.sent] == ["0400000001", "0400090001"]


def test_a_map_without_speed_says_so_when_it_is_asked_for(client, answer, tmp_path):
    path = make_map(
        tmp_path,
        '[input_registers.x]\naddress = 0\ntype = "int16"\nsource = "position"\n',
        "encoder_406",
    )
    sensor = PositionSensor(client, 4, path)
    answer([1])
    sensor.poll()
    with pytest.raises(DeviceMismatchError, match='has source "speed"'):
        sensor.speed  # noqa: B018 - the property raises


def test_a_sample_that_was_read_before_grows_old(client, link, answer):
    sensor = PressureSensor(client, 2, max_age=0.05)
    answer(OWN)
    sensor.poll()
    link.time += 0.04
    answer(OWN)
    sensor.poll()
    assert sensor.received_at == 100.0
    link.time += 0.02
    answer(OWN)
    sensor.poll()
    with pytest.raises(StaleValueError, match=r"came 60\.0 ms ago; at most 50 ms are right"):
        sensor.pressure  # noqa: B018 - the property raises
    answer([*words(51.0), 0, 8, 0])
    sensor.poll()
    assert sensor.reading == (51e5, "Pa", link.time, True)


def test_a_device_without_a_sample_number_is_fresh_whenever_it_answers(
    client, link, answer, tmp_path
):
    path = make_map(
        tmp_path, '[input_registers.a]\naddress = 0\ntype = "int16"\nsource = "pressure"'
    )
    sensor = PressureSensor(client, 2, path)
    for time in (100.0, 200.0):
        link.time = time
        answer([1])
        sensor.poll()
        assert sensor.received_at == time


def test_no_answer_leaves_the_value_that_grows_old(client, answer):
    sensor = PressureSensor(client, 2)
    answer(OWN)
    sensor.poll()
    with pytest.raises(DriverTimeoutError):
        sensor.poll()
    with pytest.raises(StaleValueError):
        sensor.reading  # noqa: B018 - the property raises


def identification(vendor, product):
    objects = bytes([0, len(vendor)]) + vendor + bytes([1, len(product)]) + product
    return bytes([0x2B, 0x0E, 1, 0x82, 0, 0, 2]) + objects


def test_the_identity_is_compared_with_the_map(client, answer):
    sensor = PressureSensor(client, 2)
    answer(identification(b"hil-bench", b"PT-404"), OWN)
    sensor.setup()
    assert sensor.is_valid
    for vendor, product, name in ((b"maker", b"PT-404", "vendor"), (b"hil-bench", b"X", "product")):
        answer(identification(vendor, product))
        with pytest.raises(DeviceMismatchError, match=name):
            sensor.setup()


def test_a_device_without_identification_is_taken_at_its_word(client, answer):
    sensor = PressureSensor(client, 2)
    answer(b"\xab\x01", OWN)
    sensor.setup()
    assert sensor.is_valid


@pytest.mark.parametrize(
    "text",
    [
        "[device",
        "[device]",
        HEAD.format(profile="pressure_404") + "[input_registers.a]\naddress = 1",
        HEAD.format(profile="pressure_404")
        + '[input_registers.a]\naddress=1\nsource="p"\ntype="x"',
        HEAD.format(profile="pressure_404")
        + '[input_registers.a]\naddress=1\nsource="p"\nunit="x"',
        "device = 1",
    ],
)
def test_a_map_that_is_none_is_refused(client, make_file, text):
    path = make_file("map.toml", text)
    with pytest.raises(RegisterMapError, match=r"map\.toml: is not a register map"):
        PressureSensor(client, 2, path)


def test_a_missing_map_is_refused(client, tmp_path):
    with pytest.raises(RegisterMapError, match="FileNotFoundError"):
        PressureSensor(client, 2, tmp_path / "missing.toml")


def test_a_map_for_another_kind_of_device_is_refused(client, tmp_path):
    with pytest.raises(DeviceMismatchError, match="a map for pressure_404 is right"):
        PressureSensor(client, 2, REGISTERS / "encoder_406.toml")
    with pytest.raises(DeviceMismatchError, match='has source "pressure"'):
        PressureSensor(client, 2, make_map(tmp_path, ""))


# The valve's own map: position, sample, status word, error code in six registers.
def status(word, error=0, position=0.0):
    return [*words(position), 0, 7, word, error]


WRITTEN = bytes.fromhex("10 0000 0003")


def test_the_valve_is_commanded_by_one_request(client, link, answer):
    valve = ProportionalValve(client, 1)
    answer(WRITTEN, [0x001F])
    valve.enable()
    # Set-point 0 and control word 7; then the status word alone is read.
    assert [sent[7:].hex() for sent in link.sent] == ["100000000306000000000007", "0400040001"]


def test_enable_repeats_its_command_until_the_time_is_over(client, answer):
    valve = ProportionalValve(client, 1)
    answer(*[WRITTEN, [0x0018]] * 50)
    with pytest.raises(DriverTimeoutError, match=r"valve not ACTIVE within 0\.02 s: it is INIT$"):
        valve.enable(timeout=0.02)


def test_a_fault_names_its_code(client, answer):
    valve = ProportionalValve(client, 1)
    answer(WRITTEN, [0x0013], [0x8100])
    with pytest.raises(DeviceFaultError, match="FAULT_HOLD after error 0x8100") as caught:
        valve.enable()
    assert caught.value.code == 0x8100
    answer(WRITTEN, [0x0000], [0x8100], [0x8100])
    with pytest.raises(DeviceFaultError, match="NOT_READY after"):
        valve.enable()


def test_a_status_word_without_a_state_is_an_error(client, answer):
    valve = ProportionalValve(client, 1)
    answer([0x0002])
    with pytest.raises(RemoteProtocolError, match="0x0002 is no state"):
        valve.read_state()


def test_set_up_takes_control_and_close_gives_it_back(client, link, answer):
    valve = ProportionalValve(client, 1)
    answer(b"\xab\x01", status(0x08), bytes.fromhex("10 0003 0001"))
    answer(bytes.fromhex("05 0000 FF00"), status(0x18, position=0.25))
    valve.setup(command_timeout=0.25)
    assert (valve.state, valve.spool_position) == (ValveState.INIT, 0.25)
    # The watchdog is 250 ms, and is set before control is taken.
    assert [sent[7:].hex() for sent in link.sent[2:4]] == ["10000300010200fa", "050000ff00"]
    link.sent.clear()
    answer(WRITTEN, [0x0019], bytes.fromhex("05 0000 0000"))
    valve.close()
    assert [sent[7:].hex() for sent in link.sent] == [
        "100000000306000000000001",
        "0400040001",
        "0500000000",
    ]


def test_a_valve_that_cannot_be_reached_is_closed_with_a_warning(client, link, answer, caplog):
    valve = ProportionalValve(client, 1)
    answer(b"\xab\x01", status(0x08), bytes.fromhex("10 0003 0001"))
    answer(bytes.fromhex("05 0000 FF00"), status(0x18))
    with valve:
        valve.setup()
        link.refuses = True
        link.play(ConnectionResetError("gone"))
    assert "could not be disabled" in caplog.text
    assert "could not be given back" in caplog.text


@pytest.mark.parametrize("time", [-0.1, 0.0005, 65.536, math.nan, math.inf])
def test_a_command_time_out_that_makes_no_sense_is_refused(client, link, time):
    with pytest.raises(ValueError, match=r"0\.001 to 65\.535 s is right"):
        ProportionalValve(client, 1).setup(command_timeout=time)
    assert link.sent == []


@pytest.mark.parametrize(
    ("kind", "unit", "good", "bad"),
    [
        ("uint16", "s", [0.0, 0.51, 65.5], [0.5, 0.1]),  # round(0.5) is 0
        ("int16", "ms", [0.0, 0.001, 32.767], [32.768]),
        ("uint16", "ms", [65.535], []),
    ],
)
def test_a_watchdog_that_would_be_off_or_cannot_hold_the_time_is_refused(
    client, link, tmp_path, kind, unit, good, bad
):
    text = (REGISTERS / "valve_408.toml").read_text(encoding="utf-8")
    before, head, after = text.partition("[holding_registers.watchdog]\n")
    entry, blank, rest = after.partition("\n\n")
    entry = re.sub(r'type = ".*"', f'type = "{kind}"', re.sub(r"(?m)^(unit|scale).*\n?", "", entry))
    path = tmp_path / "map.toml"
    path.write_text(f'{before}{head}{entry}\nunit = "{unit}"{blank}{rest}', encoding="utf-8")
    for time in good:
        with pytest.raises(DriverTimeoutError):  # it is taken: the device is asked
            ProportionalValve(client, 1, path).setup(command_timeout=time)
    asked = len(link.sent)
    for time in bad:
        with pytest.raises(ValueError, match=rf"watchdog \({kind}, .* s a count\) holds"):
            ProportionalValve(client, 1, path).setup(command_timeout=time)
    assert (asked, len(link.sent)) == (len(good), asked)


def test_a_map_with_its_commands_apart_gets_two_requests(client, link, answer, tmp_path):
    path = make_map(
        tmp_path,
        "\n".join(
            f'[{table}.{name}]\naddress = {address}\nsource = "{source}"\n'
            + (f'type = "{kind}"\n' if kind else "")
            for table, name, address, source, kind in (
                ("input_registers", "s", 0, "0x6041", "uint16"),
                ("input_registers", "p", 1, "spool_position", "int16"),
                ("holding_registers", "y", 0, "spool_setpoint", "int16"),
                ("holding_registers", "w", 5, "control_word", "uint16"),
                ("holding_registers", "t", 6, "watchdog", "uint16"),
                ("coils", "c", 0, "0x604F", ""),
            )
        ),
        "valve_408",
    )
    valve = ProportionalValve(client, 1, path)
    answer(bytes.fromhex("10 0000 0001"), bytes.fromhex("10 0005 0001"), [0x1F])
    valve.enable()
    assert [sent[7:].hex() for sent in link.sent[:2]] == ["1000000001020000", "1000050001020007"]
