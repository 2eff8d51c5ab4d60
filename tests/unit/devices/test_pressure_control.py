"""Control modes pressure and p/Q, dither and identification of the valve on its node.

100 % are 16384 of spool and of pressure, which is 200 bar here; the tick is 1 ms. The gain
0x2380.01 is 1.00. Without integral time (0x2380.02 = 0) the spool is gain times
deviation.
"""

import math

import pytest
from support.valves import activate, control, demand, fit_valve, set_up, status

from device_profiles import VALVE_408

FULL = 200e5
VALUE, TOO_LOW = 0x06090030, 0x06090032
PRESSURE, PRESSURE_AND_FLOW = 4, 5
PRESSURE_ACTIVE = 1 << 8


@pytest.fixture
def bare(make_rig):
    return fit_valve(make_rig(VALVE_408))


@pytest.fixture
def make_valve(bare):
    """A valve with a pressure sensor, without integral part, at 50 % of its pressure set-point."""

    def make(mode, sense=1, integral_ms=0):
        bare.valve.pressure_control.fit_sensor(FULL, sense)
        set_up(bare, x6043=mode, x6380=8192)
        assert bare.write(0x2380, 1, 100, 2) is None
        assert bare.write(0x2380, 2, integral_ms, 2) is None
        return activate(bare)

    return make


def measure(rig, share):
    rig.valve.measure_pressure(share * FULL, rig.now)


@pytest.mark.parametrize("mode", [PRESSURE, PRESSURE_AND_FLOW])
def test_a_valve_without_a_sensor_refuses_the_modes(bare, mode):
    assert bare.write(0x6043, 0, mode, 1) == VALUE
    assert bare.value(0x605F) == 1 << 2


@pytest.mark.parametrize("mode", [1, 3])
def test_other_modes_are_refused(make_valve, mode):
    assert make_valve(PRESSURE).write(0x6043, 0, mode, 1) is not None


@pytest.mark.parametrize(
    ("share", "sense", "spool"),
    [(0.0, 1, 0.5), (0.25, 1, 0.25), (0.75, 1, -0.25), (0.25, -1, -0.25)],
)
def test_the_spool_follows_the_deviation(make_valve, share, sense, spool):
    valve = make_valve(PRESSURE, sense)
    measure(valve, share)
    assert demand(valve, 3000) == round(spool * 16384)  # whatever 0x6300 asks for
    assert valve.value(0x6381, 1) == round(share * 16384)
    assert valve.value(0x6390, 1) == 8192
    assert valve.value(0x63D0, 1) == 8192 - round(share * 16384)
    assert not status(valve) & PRESSURE_ACTIVE


@pytest.mark.parametrize(
    ("sense", "flow", "share", "spool", "is_active"),
    [
        (1, 0.2, 0.0, 0.2, False),  # asked 0.5: the flow has it
        (1, 0.2, 0.4, 0.1, True),  # asked 0.1: less than the flow
        (1, 0.2, 0.6, -0.1, True),
        (1, -0.3, 0.0, -0.3, False),  # lowering the pressure is not held back
        (-1, -0.2, 0.0, -0.2, False),
        (-1, -0.2, 0.4, -0.1, True),
        (-1, 0.3, 0.0, 0.3, False),
    ],
)
def test_p_q_takes_what_raises_the_pressure_less(make_valve, sense, flow, share, spool, is_active):
    valve = make_valve(PRESSURE_AND_FLOW, sense)
    measure(valve, share)
    assert demand(valve, round(flow * 16384)) == pytest.approx(spool * 16384, abs=1)
    assert bool(status(valve) & PRESSURE_ACTIVE) is is_active


def test_the_integral_part_grows_with_time(make_valve):
    valve = make_valve(PRESSURE, integral_ms=100)
    measure(valve, 0.4)  # deviation 0.1: 0.1 / 100 ms is 0.001 a tick
    first = demand(valve, 0)
    valve.tick(50)
    assert valve.value(0x6310, 1) - first == pytest.approx(0.05 * 16384, abs=1)


def test_nothing_is_integrated_while_the_flow_has_the_spool(make_valve):
    valve = make_valve(PRESSURE_AND_FLOW, integral_ms=100)
    measure(valve, 0.0)
    assert demand(valve, 1638) == 1638
    valve.tick(500)
    measure(valve, 0.5)  # no deviation: what was integrated shows
    assert demand(valve, 1638) == 0


@pytest.mark.parametrize("sense", [1, -1])
def test_it_leaves_a_limit_as_soon_as_the_pressure_is_too_high(make_valve, sense):
    """0.1 of deviation moves the integral by 1 in 1 s: 0.4 up, then down from beyond the flow."""
    valve = make_valve(PRESSURE_AND_FLOW, sense, integral_ms=100)
    measure(valve, 0.5)
    demand(valve, sense * 16384)
    measure(valve, 0.4)
    valve.tick(400)
    measure(valve, 0.6)
    assert demand(valve, sense * 3277) == sense * 3277  # asks for 0.3, the flow is 0.2
    valve.tick(300)
    assert valve.value(0x6310, 1) == pytest.approx(0, abs=0.005 * 16384)


@pytest.mark.parametrize("sense", [1, -1])
def test_nothing_is_integrated_beyond_the_end_of_the_spool(make_valve, sense):
    """At a deviation of -0.4 the spool ends when the integral is -0.6; there it stays."""
    valve = make_valve(PRESSURE, sense, integral_ms=100)
    measure(valve, 0.9)
    demand(valve, 0)
    valve.tick(1000)
    measure(valve, 0.5)
    assert demand(valve, 0) == pytest.approx(-0.6 * sense * 16384, abs=0.01 * 16384)


def test_hold_has_the_spool_and_forgets_the_integral(make_valve):
    valve = make_valve(PRESSURE, integral_ms=100)
    set_up(valve, x6314=1000)
    measure(valve, 0.4)
    valve.tick(100)
    control(valve, 0x0003)
    assert valve.value(0x6310, 1) == 1000
    measure(valve, 0.5)
    assert demand(valve, 0) == 0


def test_limits_and_factor_of_the_pressure(make_valve):
    valve = make_valve(PRESSURE)
    set_up(valve, x63A0=4096)
    measure(valve, 0.0)
    assert demand(valve, 0) == 4096
    set_up(valve, x63A2=0x0001_0002)
    assert demand(valve, 0) == 2048
    assert valve.write(0x63A0, 1, -1, 2, signed=True) == TOO_LOW  # below the lower limit, 0


def test_a_sensor_without_a_value_leaves_the_last(make_valve):
    valve = make_valve(PRESSURE)
    measure(valve, 0.25)
    measure(valve, math.nan)
    assert demand(valve, 0) == 4096


def test_a_new_pressure_reference_scales_the_rest(make_valve):
    valve = make_valve(PRESSURE)
    set_up(valve, x6391=10_000, x6380=5000)
    measure(valve, 0.25)
    assert demand(valve, 0) == 4096
    assert valve.value(0x6381, 1) == 2500


def test_the_dither_swings_about_the_demand(bare):
    activate(bare, 8192)
    set_up(bare, x6361=1000, x6362=250, x6360=1)
    spools = []
    for _ in range(4):
        bare.tick()
        spools.append(round(bare.spool / 1e-3 * 16384))
    # 250 Hz: a period is four ticks, which fall on zeros and peaks.
    assert sorted(spools) == [7192, 8192, 8192, 9192]
    assert bare.value(0x6310, 1) == 8192


def test_without_active_there_is_no_dither(bare):
    set_up(bare, x6361=1000, x6362=250, x6360=1)
    for _ in range(4):
        bare.tick()
        assert bare.spool == 0.0


def test_the_device_tells_what_it_is(bare):
    od = bare.object_dictionary
    od.variable(0x1018, 4).value = 0x1234ABCD
    bare.valve.pressure_control.fit_sensor(FULL, 1)
    bare.nmt(bare.RESET_NODE)
    od.variable(0x1018, 4).value = 0x1234ABCD
    bare.tick()
    assert bare.value(0x6052) == f"{od.number(0x1018, 4):08X}"
    assert bare.value(0x605F) == (1 << 2) + (1 << 4) + (1 << 5)


def test_a_new_spool_reference_acts_at_once(bare):
    activate(bare, 8192)
    set_up(bare, x6311=8192)
    bare.tick()
    assert bare.spool == pytest.approx(1e-3)
    assert bare.write(0x6311, 1, 0, 2) == TOO_LOW
