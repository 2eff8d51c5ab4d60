"""The driver of a rotary sensor against transcripts: turns counted on, odd answers, other maps."""

import math
import struct

import pytest

from hil_drivers import DeviceMismatchError
from hil_drivers.modbus import RotarySensor

TURN_STEPS, RANGE_STEPS = 65536, 65536 * 4096
TURN = math.tau


def block(position, *, rpm=0.0, turn_steps=TURN_STEPS, range_steps=RANGE_STEPS, alarms=0):
    """The registers of the profile's own map from `speed` to `range_steps`."""
    raw = struct.pack(">fIHIII", rpm, 7, alarms, position, turn_steps, range_steps)
    return list(struct.unpack(">11H", raw))


@pytest.fixture
def angle_after(client, answer):
    """Gives the angle [rev] after each of some answers of one device."""
    sensor = RotarySensor(client, 4)

    def read(*answers):
        angles = []
        for given in answers:
            answer(given)
            sensor.poll()
            angles.append(sensor.angle / TURN)
        return angles

    return read


def test_one_request_reads_all_in_si(client, link, answer):
    sensor = RotarySensor(client, 4)
    answer(block(TURN_STEPS // 4, rpm=-30.0))
    sensor.poll()
    assert [sent[7:] for sent in link.sent] == [bytes.fromhex("04 0002 000B")]
    assert sensor.speed == pytest.approx(-math.pi)  # half a revolution a second
    assert sensor.reading == (pytest.approx(math.pi / 2), "rad", 100.0, True)


def test_turns_are_counted_on_both_ways(angle_after):
    """Of 4096 revolutions, steps of 2047.5 go on; 4095.5 are half a revolution back."""
    shown = (0.0, 4095.5, 0.0, 2047.5, 4095.0, 0.5, 4095.0)
    answers = [block(int(turns * TURN_STEPS)) for turns in shown]
    assert angle_after(*answers) == [0.0, -0.5, 0.0, 2047.5, 4095.0, 4096.5, 4095.0]


def test_a_range_that_is_no_power_of_two(angle_after):
    answers = [
        block(position, turn_steps=3600, range_steps=36001) for position in (35999, 2, 36000, 1)
    ]
    # 4 steps on, 3 back, 2 on.
    steps = [35999, 36003, 36000, 36002]
    assert angle_after(*answers) == pytest.approx([each / 3600 for each in steps])


def test_other_steps_begin_anew(angle_after):
    answers = [block(RANGE_STEPS - 1), block(0), block(1800, turn_steps=3600, range_steps=36000)]
    assert angle_after(*answers) == pytest.approx([4096.0, 4096.0, 0.5], abs=1e-4)


def test_an_alarm_is_no_valid_angle(client, answer):
    sensor = RotarySensor(client, 4)
    answer(block(5, alarms=1))
    sensor.poll()
    assert not sensor.is_valid


@pytest.mark.parametrize("name", ["turn_steps", "range_steps"])
def test_a_device_without_steps_is_refused(client, answer, name):
    sensor = RotarySensor(client, 4)
    answer(block(5, **{name: 0}))
    sensor.poll()
    with pytest.raises(DeviceMismatchError, match=f"{name} is 0; 1 or more is right"):
        sensor.angle  # noqa: B018 - the property raises


def test_a_map_without_speed_says_so_when_it_is_asked_for(client, answer, tmp_path):
    path = tmp_path / "map.toml"
    sources = ["0x6004", "turn_steps", "range_steps"]
    path.write_text(
        '[device]\nprofile = "rotary_encoder_406"\nvendor_name = "m"\nproduct_code = "P"\n'
        + "".join(
            f'[input_registers.r{n}]\naddress = {n}\ntype = "uint16"\nsource = "{source}"\n'
            for n, source in enumerate(sources)
        )
        + "scale = 10\n"
    )
    sensor = RotarySensor(client, 4, path)
    for position in (90, 1530):  # of a turn of 360 steps, in a range of 360 tens
        answer([position, 360, 360])
        sensor.poll()
        assert sensor.angle == pytest.approx(TURN * position / 360)
    assert sensor.is_valid
    with pytest.raises(DeviceMismatchError, match='has source "speed"'):
        sensor.speed  # noqa: B018 - the property raises
    path.write_text(path.read_text().replace("range_steps", "steps"))
    with pytest.raises(DeviceMismatchError, match='has source "range_steps"'):
        RotarySensor(client, 4, path)
