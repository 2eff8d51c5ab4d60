"""Axis position control of the valve on its node, by its object dictionary.

Positions are in um. The gain 0x2600.01 is 20 1/m here: 10 mm off, 10000 um, open the spool by 20 %,
3277 of 16384. The tick is 1 ms.
"""

import pytest
from support.valves import ACTIVE, FAULT_HOLD, HOLD, activate, control, fit_valve, set_up, status

from device_profiles import VALVE_408
from hil_bench.abilities.eyes.values import scale_of
from hil_bench.canopen_device.eds import load_eds

AXIS_POSITION, SPOOL = 9, 2
VALUE, TOO_LOW, TOO_HIGH = 0x06090030, 0x06090032, 0x06090031
LIMITED, DEVIATION = 1 << 10, 1 << 11
IN_POSITION, STANDS, NEAR = 1 << 1, 1 << 3, 1 << 5
FULL = 16384


@pytest.fixture
def bare(make_rig):
    return fit_valve(make_rig(VALVE_408))


@pytest.fixture
def valve(bare):
    """A valve in axis position control, ACTIVE, at position 0 with set-point 0."""
    bare.valve.position_control.is_fitted = True
    set_up(bare, x6043=AXIS_POSITION)
    measure(bare, 0)
    return activate(bare)


def measure(rig, micrometres, speed=0):
    rig.valve.measure_position(micrometres * 1e-6, speed * 1e-6, rig.now)


def ask(rig, micrometres):
    set_up(rig, x6600=micrometres)
    rig.tick()


def opening(rig):
    return rig.value(0x6310, 1)


def test_a_valve_without_a_sensor_refuses_the_mode(bare):
    assert bare.write(0x6043, 0, AXIS_POSITION, 1) == VALUE
    assert bare.value(0x605F) == 1 << SPOOL


def test_the_capability_names_the_mode(bare):
    bare.valve.position_control.is_fitted = True
    bare.nmt(0x81)
    bare.tick()
    assert bare.value(0x605F) == 1 << SPOOL | 1 << AXIS_POSITION


@pytest.mark.parametrize(
    ("setpoint", "actual", "spool"),
    [(10_000, 0, 3277), (-10_000, 0, -3277), (10_000, 12_500, -819), (90_000, 0, FULL)],
)
def test_the_spool_follows_the_deviation(valve, setpoint, actual, spool):
    measure(valve, actual)
    ask(valve, setpoint)
    assert opening(valve) == spool
    assert valve.value(0x6610, 1) == setpoint
    assert valve.value(0x6601, 1) == actual
    assert valve.value(0x6650, 1) == setpoint - actual


def test_the_integral_part_grows_by_its_time(valve):
    """10 mm off are 20 %; with 100 ms, after 50 ms another 10 % are integrated."""
    assert valve.write(0x2600, 2, 100, 2) is None
    ask(valve, 10_000)
    before = opening(valve)
    for _ in range(50):
        valve.tick()
    assert opening(valve) - before == pytest.approx(0.1 * FULL, abs=2)


def test_the_spool_set_point_does_nothing_meanwhile(valve):
    control(valve, 0x0007, 8000)
    assert opening(valve) == 0


def test_limits_hold_the_set_point_back_and_the_status_word_says_so(valve):
    set_up(valve, x6620=5_000, x6621=-2_000)
    ask(valve, 10_000)
    assert valve.value(0x6610, 1) == 5_000
    assert status(valve) == ACTIVE | LIMITED
    ask(valve, 3_000)
    assert status(valve) == ACTIVE


def test_limits_that_cross_are_refused(valve):
    set_up(valve, x6620=5_000, x6621=-2_000)
    assert valve.write(0x6620, 1, -2_001, 4, signed=True) == TOO_LOW
    assert valve.write(0x6621, 1, 5_001, 4) == TOO_HIGH


@pytest.mark.parametrize(
    ("target", "held"), [(0, 2_000), (1, 10_000), (2, 4_000)], ids=["object", "demand", "actual"]
)
def test_hold_controls_the_position_that_its_target_says(valve, target, held):
    assert valve.write(0x2600, 3, target, 1) is None
    set_up(valve, x6614=2_000)
    ask(valve, 10_000)
    measure(valve, 4_000)
    control(valve, 0x0003)
    assert status(valve) == HOLD
    assert valve.value(0x6610, 1) == held
    measure(valve, 4_500)
    valve.tick()
    assert valve.value(0x6610, 1) == held
    assert opening(valve) == pytest.approx((held - 4_500) * 20e-6 * FULL, abs=1)


def test_below_hold_the_spool_has_its_own_hold_set_point(valve):
    set_up(valve, x6314=100)
    ask(valve, 10_000)
    control(valve, 0x0001)
    assert opening(valve) == 100


def test_without_a_measured_value_the_spool_has_its_hold_set_point(valve):
    set_up(valve, x6314=100)
    ask(valve, 10_000)
    valve.valve.measure_position(float("nan"), float("nan"), valve.now)
    valve.tick()
    assert opening(valve) == 100
    assert valve.value(0x6601, 1) == 0


def test_a_deviation_that_lasts_is_a_fault(valve):
    set_up(valve, x6652=20, x6654=5_000, x6655=-5_000)
    assert valve.write(0x6651, 0, 1, 1) is None
    ask(valve, 6_000)
    for _ in range(18):
        valve.tick()
    assert status(valve) == ACTIVE
    for _ in range(2):
        valve.tick()
    assert status(valve) & 0xF == FAULT_HOLD
    assert valve.value(0x604E) == 0x8303
    valve.tick()
    control(valve, 0x0000)
    control(valve, 0x0008)
    assert valve.value(0x604E) == 0


def test_the_monitoring_does_not_watch_a_loop_that_is_open(valve):
    set_up(valve, x6043=SPOOL, x6652=20, x6654=5_000, x6655=-5_000)
    assert valve.write(0x6651, 0, 1, 1) is None
    ask(valve, 6_000)
    measure(valve, 90_000)
    for _ in range(50):
        valve.tick()
    assert status(valve) == ACTIVE


@pytest.mark.parametrize(
    ("actual", "speed", "expected"),
    [
        (0, 0, STANDS),
        (9_200, 0, STANDS | NEAR),
        (9_950, 0, STANDS | NEAR | IN_POSITION),
        (9_950, 500, NEAR),
        (9_900, 0, STANDS | NEAR),  # the window itself is outside
    ],
)
def test_the_axis_status_word_has_its_windows(valve, actual, speed, expected):
    for index, subindex, value in ((0x570C, 1, 100), (0x570C, 2, 1_000), (0x570D, 1, 500)):
        assert valve.write(index, subindex, value, 4) is None
    ask(valve, 10_000)
    measure(valve, actual, speed)
    assert valve.value(0x561D) == expected
    assert valve.value(0x6501, 1) == speed


def test_a_window_below_zero_is_refused(valve):
    assert valve.write(0x570C, 1, -1, 4, signed=True) == TOO_LOW
    assert valve.write(0x2600, 3, 3, 1) == TOO_HIGH


def test_monitors_read_the_positions_in_millimetres():
    factor, unit, _ = scale_of(load_eds(VALVE_408, 1), 0x6601, 1)
    assert (factor, unit.symbol) == (pytest.approx(1e-3), "mm")
