"""Field value to process value, zero, tare and interrupts, over the bus; the unit is bar."""

import math
import struct

import pytest

from device_profiles import PRESSURE_404
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.errors import EdsError

BAR = 1e5
ZERO, TARE = 0x6F72657A, 0x65726174  # "zero" and "tare", the first letter in the lowest byte
UNIT_KPA = 0x03220000
NOT_TRANSFERRED, DEVICE_STATE, VALUE = 0x08000020, 0x08000022, 0x06090030
LARGEST = 3.4028234663852886e38  # of REAL32 (IEEE 754)


@pytest.fixture
def rig(make_rig):
    rig = make_rig(PRESSURE_404)
    rig.device = PressureDevice(rig.node, (0.0, 250 * BAR))
    apply(rig, 0.0)
    return rig


def apply(rig, bar):
    """Let the transducer measure this pressure from now on, and run one tick."""
    rig.work = lambda now: rig.device.publish(bar * BAR, now)
    rig.tick()


def write_real(rig, index, value):
    return rig.write(index, 1, int.from_bytes(struct.pack("<f", value), "little"), 4)


def set_real(rig, **values):
    for name, value in values.items():
        assert write_real(rig, int(name[1:], 16), value) is None


def measure(rig, bar):
    apply(rig, bar)
    return rig.value(0x6130, 1)


@pytest.mark.parametrize(
    ("bar", "expected"),
    # The line through (50, 0) and (150, 10): a tenth of what is above 50 bar.
    [(50.0, 0.0), (150.0, 10.0), (100.0, 5.0), (250.0, 20.0), (0.0, -5.0)],
)
def test_two_points_make_a_line(rig, bar, expected):
    set_real(rig, x6120=50.0, x6121=0.0, x6122=150.0, x6123=10.0)
    assert measure(rig, bar) == pytest.approx(expected)
    assert rig.value(0x7130, 1) == round(100 * expected)  # two digits
    assert rig.value(0x6100, 1) == pytest.approx(bar)


def test_points_above_each_other_are_no_line(rig):
    set_real(rig, x6120=50.0, x6121=0.0, x6122=50.0, x6123=10.0)
    assert measure(rig, 100.0) == pytest.approx(100.0)


def test_factor_and_offsets(rig):
    set_real(rig, x6126=2.0, x6127=-3.0, x6124=0.5)
    assert measure(rig, 100.0) == pytest.approx(197.5)  # 100 * 2 - 3 + 0.5


def test_the_factor_counts_after_the_line(rig):
    # (100 - 50) / 10 = 5, times 2, plus 1.
    set_real(rig, x6120=50.0, x6121=0.0, x6122=150.0, x6123=10.0, x6126=2.0, x6127=1.0)
    assert measure(rig, 100.0) == pytest.approx(11.0)


def test_the_factor_is_1_until_somebody_writes_it(rig):
    assert rig.value(0x6126, 1) == 1.0
    assert write_real(rig, 0x6126, 0.0) == VALUE
    set_real(rig, x6126=-1.0)
    assert measure(rig, 100.0) == pytest.approx(-100.0)
    rig.nmt(rig.RESET_NODE)
    assert measure(rig, 100.0) == pytest.approx(100.0)
    assert rig.value(0x6126, 1) == 1.0


def test_what_is_no_number_is_refused(rig):
    indices = [*range(0x6120, 0x6125), 0x6126, 0x6127, *range(0x6133, 0x6136), 0x6138]
    for value in (math.nan, math.inf, -math.inf):
        found = {index: write_real(rig, index, value) for index in indices}
        assert found == dict.fromkeys(indices, VALUE)


def test_a_value_that_no_format_holds_shows_as_none(rig):
    set_real(rig, x6126=LARGEST)
    assert math.isnan(measure(rig, 100.0))
    assert (rig.value(0x7130, 1), rig.value(0x9130, 1)) == (-32768, -2147483648)
    assert math.isnan(rig.value(0x6140, 1))
    set_real(rig, x6126=1.0)
    assert measure(rig, 100.0) == pytest.approx(100.0)


def test_a_net_value_that_real32_cannot_hold_shows_as_none(rig):
    set_real(rig, x6126=3e36, x6138=-3e38)
    assert measure(rig, 100.0) == pytest.approx(3e38)
    assert math.isnan(rig.value(0x6140, 1))  # 6e38
    assert measure(rig, -1.0) == pytest.approx(-3e36)
    assert rig.value(0x6140, 1) == pytest.approx(2.97e38)


def test_a_line_of_infinite_slope_is_no_value(rig):
    set_real(rig, x6120=0.0, x6121=-LARGEST, x6122=1e-45, x6123=LARGEST)
    assert math.isnan(measure(rig, 100.0))


@pytest.mark.parametrize(
    ("constant", "expected"),
    # value += (sample - value) / constant, from 0 towards 100 (Axiomatic, 61A0h)
    [(1, [100.0, 100.0]), (2, [50.0, 75.0, 87.5]), (4, [25.0, 43.75])],
)
def test_a_moving_average(rig, constant, expected):
    assert rig.write(0x61A1, 1, constant, 1) is None
    assert rig.write(0x61A0, 1, 1, 1) is None
    apply(rig, 0.0)
    assert [measure(rig, 100.0) for _ in expected] == pytest.approx(expected)
    assert rig.value(0x6100, 1) == pytest.approx(expected[-1])


def test_a_repeating_average(rig):
    assert rig.write(0x61A1, 1, 3, 1) is None
    assert rig.write(0x61A0, 1, 2, 1) is None
    # Until the first three are there, the first one stands; then the mean of each three.
    measured = [measure(rig, bar) for bar in (10.0, 40.0, 70.0, 1.0, 2.0, 6.0, 7.0)]
    assert measured == pytest.approx([10.0, 10.0, 40.0, 40.0, 40.0, 3.0, 3.0])


def test_the_filter_comes_before_the_scaling(rig):
    set_real(rig, x6126=2.0)
    assert rig.write(0x61A1, 1, 2, 1) is None
    assert rig.write(0x61A0, 1, 1, 1) is None
    apply(rig, 0.0)
    assert measure(rig, 100.0) == pytest.approx(100.0)
    assert rig.value(0x6100, 1) == pytest.approx(50.0)


@pytest.mark.parametrize(("index", "value"), [(0x61A0, 3), (0x61A1, 0)])
def test_a_filter_that_does_not_exist_is_refused(rig, index, value):
    assert rig.write(index, 1, value, 1) == (0x06090031 if value else 0x06090032)


def test_an_overload_empties_the_filter(rig):
    assert rig.write(0x61A1, 1, 4, 1) is None
    assert rig.write(0x61A0, 1, 1, 1) is None
    apply(rig, 0.0)
    assert math.isnan(measure(rig, 300.0))
    assert measure(rig, 100.0) == pytest.approx(100.0)


def test_an_overload_ends_a_block_of_the_repeating_average(rig):
    assert rig.write(0x61A1, 1, 2, 1) is None
    assert rig.write(0x61A0, 1, 2, 1) is None
    apply(rig, 10.0)
    apply(rig, 300.0)
    # Begun anew: 20 and 40 are one block, and 10 is in none.
    assert [measure(rig, bar) for bar in (20.0, 40.0)] == pytest.approx([20.0, 30.0])


def test_a_stored_filter_constant_of_0_is_1(make_rig):
    rig = make_rig(PRESSURE_404)
    for index, value in ((0x61A0, 1), (0x61A1, 0)):
        rig.object_dictionary.variable(index, 1).value = value  # as read from a file
    rig.device = PressureDevice(rig.node, (0.0, 250 * BAR))
    assert [measure(rig, bar) for bar in (10.0, 20.0)] == pytest.approx([10.0, 20.0])


def test_a_new_unit_in_an_overload_brings_no_value(rig):
    apply(rig, 100.0)
    apply(rig, 300.0)
    assert rig.write(0x6131, 1, UNIT_KPA, 4) is None
    assert math.isnan(rig.value(0x6130, 1))


def test_a_new_unit_does_not_confuse_the_filter(rig):
    assert rig.write(0x61A1, 1, 4, 1) is None
    assert rig.write(0x61A0, 1, 1, 1) is None
    apply(rig, 100.0)
    assert rig.write(0x6131, 1, UNIT_KPA, 4) is None
    assert rig.value(0x6130, 1) == pytest.approx(10000.0)  # at once
    assert measure(rig, 100.0) == pytest.approx(10000.0)


def test_zero_makes_the_present_pressure_zero(rig):
    apply(rig, 30.0)
    assert rig.write(0x6125, 1, ZERO, 4) is None
    assert rig.value(0x6130, 1) == 0.0  # at once
    assert rig.value(0x6124, 1) == pytest.approx(-30.0)
    assert measure(rig, 100.0) == pytest.approx(70.0)
    assert rig.write(0x6125, 1, ZERO, 4) is None
    assert rig.value(0x6124, 1) == pytest.approx(-100.0)
    assert measure(rig, 100.0) == pytest.approx(0.0)


def test_zero_after_a_factor(rig):
    set_real(rig, x6126=2.0)
    apply(rig, 30.0)
    assert rig.write(0x6125, 1, ZERO, 4) is None
    assert rig.value(0x6124, 1) == pytest.approx(-60.0)
    assert measure(rig, 31.0) == pytest.approx(2.0)


def test_tare_makes_the_net_value_zero_only(rig):
    apply(rig, 30.0)
    assert rig.write(0x6139, 1, TARE, 4) is None
    assert (rig.value(0x6138, 1), rig.value(0x6140, 1)) == (pytest.approx(30.0), 0.0)
    assert measure(rig, 100.0) == pytest.approx(100.0)
    assert rig.value(0x6140, 1) == pytest.approx(70.0)


def test_the_tare_can_be_written(rig):
    apply(rig, 100.0)
    set_real(rig, x6138=-10.0)
    assert rig.value(0x6140, 1) == pytest.approx(110.0)  # at once


@pytest.mark.parametrize(("index", "other"), [(0x6125, TARE), (0x6139, ZERO)])
@pytest.mark.parametrize("signature", [0, 0x7A65726F, None])
def test_another_signature_is_refused(rig, index, other, signature):
    apply(rig, 30.0)
    wanted = other if signature is None else signature
    assert rig.write(index, 1, wanted, 4) == NOT_TRANSFERRED
    assert measure(rig, 30.0) == pytest.approx(30.0)
    assert (rig.value(0x6124, 1), rig.value(0x6138, 1)) == (0.0, 0.0)


@pytest.mark.parametrize(("index", "signature"), [(0x6125, ZERO), (0x6139, TARE)])
def test_without_a_value_there_is_no_zero(rig, index, signature):
    apply(rig, 300.0)
    assert rig.write(index, 1, signature, 4) == DEVICE_STATE


def test_an_offset_that_real32_cannot_hold_is_refused(rig):
    set_real(rig, x6124=LARGEST, x6127=-LARGEST, x6126=1e36)
    apply(rig, -1.0)  # -1e36 + LARGEST - LARGEST: a value, but the new offset is too large
    assert rig.write(0x6125, 1, ZERO, 4) == VALUE
    assert rig.value(0x6124, 1) == pytest.approx(LARGEST)


def test_a_tare_during_an_overload_leaves_no_value(rig):
    apply(rig, 300.0)
    set_real(rig, x6138=1.0)
    assert math.isnan(rig.value(0x6140, 1))


@pytest.fixture
def quiet(rig):
    """Operational, with no event timer: what is sent is sent by an event."""
    assert rig.write(0x1800, 5, 0, 2) is None
    rig.nmt(rig.START)
    apply(rig, 100.0)
    rig.sent(0x185)
    return rig


def sends(rig, bar):
    apply(rig, bar)
    return len(rig.sent(0x185))


def test_without_interrupts_nothing_is_sent(quiet):
    assert [sends(quiet, bar) for bar in (101.0, 0.0, -5.0, 200.0)] == [0, 0, 0, 0]


def test_the_delta_counts_from_the_last_event(quiet):
    set_real(quiet, x6133=2.0)
    # From 100: 102 is no more than the delta, 102.5 is; from there 104.5 is not, 100.4 is.
    sent = [sends(quiet, bar) for bar in (101.0, 102.0, 102.5, 104.5, 100.4, 100.4)]
    assert sent == [0, 0, 1, 0, 1, 0]


def test_a_negative_delta_takes_any_change(quiet):
    set_real(quiet, x6133=-1.0)
    assert [sends(quiet, bar) for bar in (100.001, 100.001, 100.0)] == [1, 0, 1]


def test_each_limit_counts_when_it_is_passed(quiet):
    set_real(quiet, x6134=50.0, x6135=150.0)
    bars = (150.0, 151.0, 200.0, 150.0, 151.0, 50.0, 49.0, 10.0, 60.0)
    assert [sends(quiet, bar) for bar in bars] == [0, 1, 0, 0, 1, 0, 1, 0, 0]


def test_delta_and_limits_share_an_event(quiet):
    set_real(quiet, x6133=10.0, x6134=50.0, x6135=150.0)
    # From 100: delta; both; neither; delta from 151; delta; limit; 5 from there, not 11 from 145.
    bars = (111.0, 151.0, 155.0, 162.0, 145.0, 151.0, 156.0, 162.0)
    assert [sends(quiet, bar) for bar in bars] == [1, 1, 0, 1, 1, 1, 0, 1]


def test_limits_the_wrong_way_round_are_off(quiet):
    set_real(quiet, x6134=150.0, x6135=50.0)
    assert [sends(quiet, bar) for bar in (100.0, 200.0, 10.0)] == [0, 0, 0]


def test_an_interrupt_sends_only_what_carries_the_value(quiet):
    # TPDO1 carries the status 0x6150.01 alone.
    assert quiet.write(0x1800, 1, 0xC0000185, 4) is None
    for subindex, value, size in ((0, 0, 1), (1, 0x61500108, 4), (0, 1, 1)):
        assert quiet.write(0x1A00, subindex, value, size) is None
    assert quiet.write(0x1800, 1, 0x40000185, 4) is None
    set_real(quiet, x6133=-1.0)
    quiet.sent(0x185)
    assert [sends(quiet, bar) for bar in (101.0, 102.0)] == [0, 0]


def test_what_is_no_value_interrupts_nobody(quiet):
    set_real(quiet, x6133=-1.0, x6134=50.0, x6135=150.0)
    quiet.sent(0x185)
    assert sends(quiet, 300.0) == 0
    set_real(quiet, x6126=LARGEST)
    assert sends(quiet, 120.0) == 0


def test_other_objects_of_a_wrong_kind_are_told(make_rig, tmp_path):
    text = PRESSURE_404.read_text(encoding="ascii")
    broken = tmp_path / "broken.eds"
    start = text.index("[6124sub1]")
    broken.write_text(text[:start] + text[start:].replace("0x0008", "0x0007", 1), encoding="ascii")
    rig = make_rig(broken)
    with pytest.raises(EdsError, match=r"0x6124\.01"):
        PressureDevice(rig.node, (0.0, 250 * BAR))
