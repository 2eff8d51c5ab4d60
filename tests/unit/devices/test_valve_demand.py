"""From the set-point to the demand value, over the bus. 16384 increments are 100 %, here 1 mm."""

import pytest
from support.valves import ACTIVE, FULL_OPENING, activate, demand, fit_valve, set_up

from device_profiles import IMITATIONS, VALVE_408
from hil_bench.canopen_device.eds import load_eds
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.errors import EdsError

RAMP_RUNNING, LIMITED = 1 << 9, 1 << 10


@pytest.fixture
def rig(make_rig):
    """A valve in ACTIVE at 0 whose spool is where it is told to be."""
    return activate(fit_valve(make_rig(VALVE_408)))


@pytest.mark.parametrize(
    ("factor", "offset", "setpoint", "expected"),
    # y = x * numerator / denominator + offset (Moog 7.2.4); 0x0003_0002 is 3/2.
    [
        (0x0001_0001, 100, 1000, 1100),
        (0x0003_0002, 0, 1000, 1500),
        (0x0003_0002, -100, 1000, 1400),
        (0x0001_0003, 0, -1000, -333),
        (0x0001_0003, 0, 1001, 334),  # 333.67
        (0x0003_0001, 0, 16384, 32767),  # 49152 is more than INTEGER16 holds
        (0x0003_0001, 0, -16384, -32768),
    ],
)
def test_scaling(rig, factor, offset, setpoint, expected):
    set_up(rig, x6322=factor, x6323=offset)
    assert demand(rig, setpoint) == expected
    assert rig.spool == pytest.approx(expected / 16384 * FULL_OPENING)


def test_the_limits_come_before_the_scaling(rig):
    set_up(rig, x6320=1000, x6322=0x0002_0001)
    assert demand(rig, 1500) == 2000
    assert rig.value(0x6041) == ACTIVE | LIMITED
    assert demand(rig, 1000) == 2000
    assert rig.value(0x6041) == ACTIVE


def test_the_zero_correction_is_added_to_all(rig):
    set_up(rig, x6324=-50, x6322=0x0002_0001)
    assert demand(rig, 1000) == 1950  # after the scaling
    assert demand(rig, 0) == -50


@pytest.mark.parametrize(
    ("objects", "expected"),
    # Each alone makes of 1000: 1000 + 7, 1000 * 2, 1000 / 2.
    [
        ({"x6324": 7}, 1007),
        ({"x6323": 7}, 1007),
        ({"x6322": 0x0002_0001}, 2000),
        ({"x6341": 0x0001_0002, "x6340": 1}, 500),
    ],
)
def test_each_function_works_alone(rig, objects, expected):
    set_up(rig, **objects)
    assert demand(rig, 1000) == expected


@pytest.mark.parametrize(
    ("factor", "setpoint", "expected"),
    # 1/2 halves the positive side, 2/1 the negative one.
    [(0x0001_0002, 1000, 500), (0x0001_0002, -1000, -1000), (0x0002_0001, -1000, -500)],
)
def test_directional_gain(rig, factor, setpoint, expected):
    set_up(rig, x6341=factor)
    assert demand(rig, setpoint) == setpoint
    set_up(rig, x6340=1)
    assert demand(rig, setpoint) == expected


@pytest.mark.parametrize(
    ("kind", "setpoint", "expected"),
    # A 1000, B 2000, threshold 100; slope beyond it (16384 - step) / (16384 - 100).
    [
        (1, 99, 0),
        (1, 100, 1000),
        (1, -100, -2000),
        (1, 8242, 8692),  # half way from 100 to 16384, so half way from 1000 to 16384
        (2, 50, 500),
        (2, -50, -1000),
        (0, 50, 50),
    ],
)
def test_dead_band_compensation(rig, kind, setpoint, expected):
    set_up(rig, x6343=1000, x6344=2000, x6345=100, x6342=kind)
    assert demand(rig, setpoint) == expected


def test_gain_comes_before_dead_band_and_zero_correction_last(rig):
    set_up(rig, x6341=0x0001_0002, x6340=1, x6343=1000, x6345=100, x6342=1, x6324=7)
    # 198 / 2 = 99 is below the threshold; 200 / 2 is not.
    assert demand(rig, 198) == 7
    assert demand(rig, 200) == 1007


def without_limits(rig_class, *indices):
    """A rig whose EDS gives these objects no limits, as another maker's may."""
    rig = rig_class(VALVE_408)
    for index in indices:
        for variable in rig.object_dictionary:
            if variable.index == index:
                variable.low = variable.high = None
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.work = lambda now: rig.valve.publish(rig.valve.command(now), now)
    rig.tick()
    return rig


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size", "abort"),
    [
        (0x6330, 0, 4, 1, 0x06090030),
        (0x6342, 0, -1, 1, 0x06090030),
        (0x6351, 0, 2, 1, 0x06090030),
        (0x6345, 1, -1, 2, 0x06090032),
    ],
)
def test_the_device_refuses_what_the_eds_does_not(make_rig, index, subindex, value, size, abort):
    rig = without_limits(make_rig, index)
    assert rig.write(index, subindex, value, size, signed=value < 0) == abort


def test_stored_parameters_without_meaning_switch_the_function_off(make_rig):
    rig = make_rig(VALVE_408)
    for index, value in ((0x6330, 9), (0x6342, 9), (0x6322, 0)):
        rig.object_dictionary.variable(index).value = value  # as read from a file at power on
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.work = lambda now: rig.valve.publish(rig.valve.command(now), now)
    rig.tick()
    rig.nmt(rig.START)
    assert demand(rig, 0) == 0
    assert demand(rig, 16384) == 16384


@pytest.mark.parametrize(
    ("index", "default", "told"), [(0x6330, 4, "0 to 3 exist"), (0x6322, 0x10000, "denominator")]
)
def test_a_default_without_meaning_is_told_when_the_bench_is_built(make_rig, index, default, told):
    rig = make_rig(VALVE_408)
    rig.object_dictionary.variable(index).default = default
    with pytest.raises(EdsError, match=told):
        ValveDevice(rig.node, FULL_OPENING)


def test_the_times_say_their_unit():
    dictionary = load_eds(VALVE_408, 5)
    # Unit 3 is the second, prefix -3 is milli (Moog ACV manual, 2.4.3).
    for index in (*range(0x6331, 0x6337), 0x6352):
        assert dictionary.number(index, 2) == 3
        assert dictionary.number(index, 3) == -3


PDO_4 = IMITATIONS / "valve_pdo4.eds"


@pytest.fixture
def curved(make_rig):
    """A valve with a characteristic, which gives a quarter on the positive side; in ACTIVE."""
    rig = make_rig(PDO_4)
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.work = lambda now: rig.valve.publish(rig.valve.command(now), now)
    rig.tick()
    rig.nmt(rig.START)
    for n in range(128):
        variable = rig.object_dictionary.variable(0x434A, n + 1)
        variable.write(variable.value // 4)
    rig.write(0x6040, 0, 0x0007, 2)
    return rig


def bent(rig, setpoint):
    rig.write(0x6300, 1, setpoint, 2, signed=True)
    rig.tick()
    return rig.value(0x6310, 1)


def test_a_characteristic_bends_the_set_point(curved):
    assert bent(curved, 8192) == 8192
    set_up(curved, x6346=-1)
    assert bent(curved, 8192) == 2048
    assert bent(curved, -8192) == -8192
    set_up(curved, x6346=0)
    assert bent(curved, 8192) == 8192


def test_a_point_written_later_counts(curved):
    set_up(curved, x6346=-1)
    assert curved.write(0x434A, 64, 1234, 2) is None  # input 64 * 128 = 8192
    assert bent(curved, 8192) == 1234


def test_the_characteristic_is_between_gain_and_dead_band(curved):
    set_up(curved, x6346=-1, x6341=0x0001_0002, x6340=1, x6343=1000, x6345=100, x6342=1)
    # Half, then a quarter: 99 is below the threshold, 100 is on it.
    assert bent(curved, 792) == 0
    assert bent(curved, 800) == 1000


def test_a_characteristic_type_that_does_not_exist_is_refused(curved):
    assert curved.write(0x6346, 0, -2, 1, signed=True) == 0x06090032
    assert curved.write(0x6346, 0, 1, 1) == 0x06090031


def test_without_a_table_there_is_no_characteristic(make_rig):
    rig = make_rig(PDO_4, without=(0x434A,))
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.tick()
    assert rig.write(0x6346, 0, -1, 1, signed=True) == 0x06090030
