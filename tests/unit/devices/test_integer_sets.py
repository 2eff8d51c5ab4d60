"""The integer sets of a CiA 404 channel and channels beside each other.

An integer is the REAL32 value times 10^0x6132, 2 in the EDS: 12.34 bar is 1234. An INTEGER16
ends at 32767, so that 400 bar = 40000 does not fit. 0 °C are 32 °F, 55 °C are 131 °F.
"""

import math

import pytest

from device_profiles import PRESSURE_404, TRANSDUCER_404
from hil_bench.devices.pressure_404 import TEMPERATURE_UNITS, PressureDevice, Span, TransducerDevice

BAR = 1e5
SPAN = (0.0, 250 * BAR)
FAHRENHEIT = 0x00AC0000
VALUE = 0x06090030
READ_ONLY = 0x06010002


@pytest.fixture
def rig(make_rig):
    rig = make_rig(PRESSURE_404)
    rig.device = PressureDevice(rig.node, SPAN)
    apply(rig, 12.34 * BAR)
    return rig


def apply(rig, pressure):
    rig.work = lambda now: rig.device.publish(pressure, now)
    rig.tick()


def test_process_and_field_value_in_every_format(rig):
    faces = [rig.value(index, 1) for index in (0x7130, 0x8130, 0x9130, 0x7100, 0x9100)]
    assert faces == [1234] * 5


def test_field_values_are_before_the_line(rig):
    assert rig.write(0x7124, 1, 100, 2) is None  # offset 1 bar
    rig.tick()
    assert (rig.value(0x7100, 1), rig.value(0x7130, 1)) == (1234, 1334)


def test_no_value_has_its_mark_in_24_bits(rig):
    apply(rig, 300 * BAR)
    assert rig.value(0x8130, 1) == -(1 << 23)


@pytest.mark.parametrize(("index", "size"), [(0x7134, 2), (0x9134, 4)])
def test_a_parameter_is_one_value_in_all_formats(rig, index, size):
    assert rig.write(index, 1, -250, size, signed=True) is None
    assert rig.value(0x6134, 1) == pytest.approx(-2.5)
    assert (rig.value(0x7134, 1), rig.value(0x9134, 1)) == (-250, -250)


def test_a_limit_of_the_integer_set_sends_the_value(rig):
    rig.nmt(rig.START)
    rig.object_dictionary.variable(0x1800, 5).value = 0  # no event timer
    assert rig.write(0x7135, 1, 2000, 2) is None  # 20 bar
    apply(rig, 19 * BAR)
    rig.sent(0x185)
    apply(rig, 21 * BAR)
    rig.tick()
    assert len(rig.sent(0x185)) == 1


def test_what_does_not_fit_16_bits_shows_its_lowest_value_there(rig):
    assert rig.write(0x9135, 1, 40_000, 4) is None
    assert rig.value(0x6135, 1) == pytest.approx(400.0)
    assert rig.value(0x7135, 1) == -32768


def test_new_digits_show_at_once(rig):
    assert rig.write(0x7134, 1, 250, 2) is None
    assert rig.write(0x6132, 1, 1, 1) is None
    assert (rig.value(0x7134, 1), rig.value(0x9149, 1)) == (25, 2500)


def test_the_span_is_read_only_in_all_formats(rig):
    assert rig.write(0x7149, 1, 100, 2) == READ_ONLY
    assert rig.value(0x7149, 1) == 25_000


def test_what_was_set_is_gone_after_a_reset(rig):
    rig.write(0x7134, 1, 250, 2)
    rig.nmt(rig.RESET_NODE)
    rig.tick()
    assert [rig.value(index, 1) for index in (0x6134, 0x7134, 0x9134)] == [0, 0, 0]


@pytest.fixture
def three(make_rig):
    rig = make_rig(TRANSDUCER_404)
    pressures = Span(*SPAN)
    spans = (pressures, pressures, Span(-40.0, 125.0, TEMPERATURE_UNITS))
    rig.device = TransducerDevice(rig.node, spans)
    measure(rig, 10 * BAR, 20 * BAR, 55.0)
    return rig


def measure(rig, *values):
    def work(_now):
        for channel, value in enumerate(values, start=1):
            rig.device.publish(channel, value)

    rig.work = work
    rig.tick()


def test_each_channel_shows_its_own_quantity(three):
    assert [three.value(0x6130, n) for n in (1, 2, 3)] == pytest.approx([10.0, 20.0, 55.0])
    # 0x6132.03 is 1
    assert [three.value(0x7130, n) for n in (1, 2, 3)] == [1000, 2000, 550]


def test_a_temperature_in_fahrenheit(three):
    assert three.write(0x6131, 3, FAHRENHEIT, 4) is None
    assert three.value(0x6130, 3) == pytest.approx(131.0)
    # -40 °C are -40 °F, 125 °C are 257 °F
    assert [three.value(index, 3) for index in (0x6148, 0x6149)] == pytest.approx([-40.0, 257.0])


@pytest.mark.parametrize(("channel", "unit"), [(3, 0x004E0000), (1, 0x002D0000)])
def test_a_unit_of_another_quantity_is_refused(three, channel, unit):
    assert three.write(0x6131, channel, unit, 4) == VALUE


def test_an_overload_of_one_channel_leaves_the_others_alone(three):
    measure(three, 10 * BAR, 300 * BAR, 200.0)
    assert [three.value(0x6150, n) for n in (1, 2, 3)] == [0, 3, 3]
    assert not math.isnan(three.value(0x6130, 1))
    measure(three, 10 * BAR, 20 * BAR, 200.0)
    assert [three.value(0x6150, n) for n in (1, 2, 3)] == [0, 0, 3]
    assert three.value(0x1001) & 0x20  # the temperature still is beyond
    measure(three, 10 * BAR, 20 * BAR, 55.0)
    assert three.value(0x1001) == 0


def test_a_reset_reaches_every_channel(three):
    assert three.write(0x6131, 3, FAHRENHEIT, 4) is None
    three.nmt(three.RESET_NODE)
    three.tick()
    assert three.value(0x6130, 3) == pytest.approx(55.0)
    assert three.value(0x6149, 3) == pytest.approx(125.0)
