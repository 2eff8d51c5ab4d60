"""The linear encoder behind a real node.

Steps: 0x6005.01 = 1000 is 1 um, so that 1 m is 1,000,000 steps; 0x6005.02 = 10 is 0.1 mm/s, so
that 1 m/s is 10,000. INTEGER32 and INTEGER16 end at 2,147,483,647 and 32,767.
"""

import math
import struct

import pytest
from support.encoders import fit_encoder, move, position

from device_profiles import ENCODER_406
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.errors import EdsError

PDOS = range(0x1400, 0x1C00)


@pytest.fixture
def rig(make_rig):
    return fit_encoder(make_rig(ENCODER_406))


@pytest.mark.parametrize(
    ("metres", "steps"),
    [(0.0, 0), (0.1, 100000), (-0.1, -100000), (1.4e-6, 1), (1.6e-6, 2), (2147.483647, 2147483647)],
)
def test_position_in_steps_of_1_um(rig, metres, steps):
    move(rig, metres)
    assert position(rig) == steps


@pytest.mark.parametrize(
    ("step", "steps"),
    # 0.1 m = 100,000,000 x 1 nm
    [(1, 100000000), (100, 1000000), (5000, 20000), (100000000, 1), (4294967295, 0)],
)
def test_position_in_other_steps(rig, step, steps):
    assert rig.write(0x6005, 1, step, 4) is None
    move(rig, 0.1)
    assert position(rig) == steps
    assert rig.value(0x6501) == step


@pytest.mark.parametrize(
    ("speed", "step", "steps"),
    [(0.5, 10, 5000), (-0.5, 10, -5000), (3.2767, 10, 32767), (0.5, 1, 32767), (0.5, 100, 500)],
)
def test_speed_in_steps(rig, speed, step, steps):
    assert rig.write(0x6005, 2, step, 4) is None
    move(rig, 0.0, speed)
    assert rig.value(0x6030, 1) == steps


@pytest.mark.parametrize(("speed", "steps"), [(3.28, 32767), (-3.28, -32768), (math.inf, 32767)])
def test_a_speed_beyond_the_counter_saturates_and_warns(rig, speed, steps):
    move(rig, 0.0, speed)
    assert (rig.value(0x6030, 1), rig.value(0x6505)) == (steps, 0x0001)
    assert rig.value(0x6506) == 0x0001
    move(rig, 0.0, 1.0)
    assert (rig.value(0x6030, 1), rig.value(0x6505)) == (10000, 0)
    assert rig.emcy_codes() == []


def test_bit_3_reverses_position_and_speed(rig):
    assert rig.write(0x6000, 0, 0x0008, 2) is None
    move(rig, 0.1, 0.5)
    assert (position(rig), rig.value(0x6030, 1)) == (-100000, -5000)
    assert rig.value(0x6500) == 0x0008
    assert rig.write(0x6000, 0, 0, 2) is None
    move(rig, 0.1, 0.5)
    assert (position(rig), rig.value(0x6030, 1)) == (100000, 5000)
    assert rig.value(0x6500) == 0


@pytest.mark.parametrize(
    ("metres", "steps"),
    # 2147.483648 m is one step more than INTEGER32 holds.
    [
        (2147.483648, 2147483647),
        (-2147.483649, -2147483648),
        (math.inf, 2147483647),
        (-math.inf, -2147483648),
    ],
)
def test_a_position_beyond_the_counter_is_a_position_error(rig, metres, steps):
    move(rig, metres)
    assert position(rig) == steps
    assert (rig.value(0x6503), rig.value(0x6504)) == (0x0001, 0x0001)
    # Error register: generic (bit 0) and device profile specific (bit 5).
    assert [data[:3] for data in rig.sent(0x085)] == [bytes.fromhex("0010 21")]
    rig.tick(20)
    assert rig.emcy_codes() == []
    move(rig, 0.1)
    assert (position(rig), rig.value(0x6503)) == (100000, 0)
    assert rig.emcy_codes() == [0x0000]


def test_what_is_no_number_leaves_the_last_values(rig):
    move(rig, 0.1, 0.5)
    move(rig, math.nan, math.nan)
    assert (position(rig), rig.value(0x6030, 1)) == (100000, 5000)
    assert (rig.value(0x6503), rig.value(0x6505)) == (0x0001, 0x0000)  # no speed is no overspeed


def test_tpdo1_carries_position_and_speed_every_10_ms(rig):
    rig.nmt(rig.START)
    move(rig, -0.1, 0.5)
    rig.sent(0x185)
    rig.tick(20)
    assert rig.sent(0x185) == [struct.pack("<ih", -100000, 5000)] * 2


def test_tpdo2_is_off_and_comes_with_each_sync_once_it_is_on(rig):
    rig.nmt(rig.START)
    move(rig, 0.1)
    rig.receive(0x080)
    rig.tick()
    assert rig.sent(0x285) == []
    assert rig.write(0x1801, 1, 0x40000285, 4) is None
    for _ in range(3):
        rig.receive(0x080)
        rig.tick()
    assert rig.sent(0x285) == [struct.pack("<ih", 100000, 0)] * 3


def test_the_cyclic_timer_is_the_event_timer(rig):
    assert rig.value(0x6200) == 10
    assert rig.write(0x6200, 0, 3, 2) is None
    assert rig.value(0x1800, 5) == 3
    rig.nmt(rig.START)
    rig.tick()
    rig.sent(0x185)
    rig.tick(30)
    assert len(rig.sent(0x185)) == 10


def test_the_event_timer_is_the_cyclic_timer(rig):
    assert rig.write(0x1800, 5, 7, 2) is None
    assert rig.value(0x6200) == 7


@pytest.mark.parametrize("command", ["RESET_NODE", "RESET_COMMUNICATION"])
def test_a_reset_leaves_both_timers_equal(rig, command):
    assert rig.write(0x6200, 0, 3, 2) is None
    rig.nmt(getattr(rig, command))
    rig.tick()
    assert (rig.value(0x1800, 5), rig.value(0x6200)) == (10, 10)


def test_a_node_reset_brings_steps_and_direction_back(rig):
    assert rig.write(0x6005, 1, 1, 4) is None
    assert rig.write(0x6000, 0, 0x0008, 2) is None
    rig.nmt(rig.RESET_NODE)
    move(rig, 0.1)
    assert position(rig) == 100000
    assert (rig.value(0x6500), rig.value(0x6501)) == (0, 1000)
    assert (rig.value(0x6504), rig.value(0x6506)) == (1, 1)


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size", "abort"),
    [
        (0x6000, 0, 0x0001, 2, 0x06090030),  # code sequence, for rotary encoders
        (0x6000, 0, 0x0004, 2, 0x06090030),  # scaling
        (0x6000, 0, 0x0010, 2, 0x06090031),
        (0x6005, 1, 0, 4, 0x06090032),
        (0x6005, 2, 0, 4, 0x06090032),
        (0x6004, 0, 0, 4, 0x06010002),
    ],
)
def test_writes_are_checked(rig, index, subindex, value, size, abort):
    assert rig.write(index, subindex, value, size) == abort


@pytest.mark.parametrize("absent", [0x6004, 0x6020])
def test_one_of_the_two_positions_is_enough(make_rig, absent):
    rig = fit_encoder(make_rig(ENCODER_406, without={*PDOS, absent}))
    move(rig, 0.1)
    present = (0x6020, 1) if absent == 0x6004 else (0x6004, 0)
    assert rig.value(*present) == 100000


def test_the_smallest_object_set_works(make_rig):
    optional = {0x6000, 0x6030, 0x6200, 0x6500, 0x6501, 0x6503, 0x6504, 0x6505, 0x6506}
    rig = fit_encoder(make_rig(ENCODER_406, without={*PDOS, *optional}))
    move(rig, 0.1, 100.0)
    assert position(rig) == 100000


@pytest.mark.parametrize(
    ("without", "message"),
    [
        ({0x6004, 0x6020}, r"encoder_406\.eds: objects 0x6004\.00 and 0x6020\.01"),
        ({0x6005}, r"object 0x6005\.01"),
    ],
)
def test_an_eds_without_a_needed_object_is_refused(make_rig, without, message):
    rig = make_rig(ENCODER_406, without={*PDOS, *without})
    with pytest.raises(EdsError, match=message):
        EncoderDevice(rig.node)


@pytest.fixture
def edited_eds(tmp_path):
    """Another maker's EDS: ours with texts replaced."""

    def edit(*replacements):
        text = ENCODER_406.read_text()
        for old, new in replacements:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "other.eds"
        path.write_text(text)
        return path

    return edit


POSITION = "[6004]\nParameterName=Position value\nObjectType=0x7\nDataType=0x0004"
STEP = "DefaultValue=1000\nPDOMapping=0\n\n[6005sub2]"


def test_an_unsigned_position_cannot_be_negative(make_rig, edited_eds):
    eds = edited_eds((POSITION, POSITION.replace("0x0004", "0x0007")))
    rig = fit_encoder(make_rig(eds, without={0x6020}))
    move(rig, 2148.0)  # fits UNSIGNED32 only
    assert (rig.value(0x6004), rig.value(0x6503)) == (2148000000, 0)
    move(rig, -0.001)
    assert (rig.value(0x6004), rig.value(0x6503)) == (0, 1)


def test_a_step_of_zero_is_refused(make_rig, edited_eds):
    low = "LowLimit=1\nHighLimit=4294967295\n"
    eds = edited_eds((low + STEP, STEP.replace("1000", "0")))
    with pytest.raises(EdsError, match=r"object 0x6005\.01 .* is 0; a measuring step"):
        EncoderDevice(make_rig(eds).node)


def test_a_step_of_zero_is_refused_where_the_eds_has_no_limit(make_rig, edited_eds):
    low = "LowLimit=1\nHighLimit=4294967295\n"
    rig = fit_encoder(make_rig(edited_eds((low + STEP, STEP))))
    assert rig.write(0x6005, 1, 0, 4) == 0x06090032
    move(rig, 0.1)
    assert position(rig) == 100000


@pytest.mark.parametrize(
    ("speeds", "step", "steps"),
    # One tick is 1 ms: 0.01 m/s a tick is 10 m/s², 10000 steps of 1 mm/s².
    [
        ((0.0, 0.01), 1, 10000),
        ((0.01, 0.0), 1, -10000),
        ((0.5, 0.5), 1, 0),
        ((0.0, 0.01), 10, 1000),
        ((0.0, 0.04), 1, 32767),
        ((0.0, -0.04), 1, -32768),
    ],
)
def test_acceleration_in_steps(rig, speeds, step, steps):
    assert rig.write(0x6005, 3, step, 4) is None
    for speed in speeds:
        move(rig, 0.0, speed)
    assert rig.value(0x6040, 1) == steps


def test_the_direction_reverses_the_acceleration(rig):
    assert rig.write(0x6000, 0, 0x0008, 2) is None
    move(rig, 0.0, 0.0)
    move(rig, 0.0, 0.01)
    assert rig.value(0x6040, 1) == -10000


def test_the_first_tick_knows_no_acceleration(make_rig):
    rig = make_rig(ENCODER_406)
    rig.device = EncoderDevice(rig.node)
    move(rig, 0.0, 1.0)
    assert rig.value(0x6040, 1) == 0
    rig.nmt(rig.RESET_NODE)
    move(rig, 0.0, 2.0)
    assert rig.value(0x6040, 1) == 0
