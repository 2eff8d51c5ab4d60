"""The pressure transducer behind a real node; its span is 0 to 250 bar.

Units: 1 bar = 100,000 Pa, 1 psi = 6894.757293168 Pa (0.45359237 kg x 9.80665 m/s² on a square
inch). Overload: beyond 3.125 % of the span, marks and status bits of the WIKA MH-4-CAN special
documentation, object 6150h. Of 250 bar, 3.125 % are 7.8125 bar, so that -7.8125 to 257.8125 bar
are measured.
"""

import math
import struct

import pytest

from device_profiles import PRESSURE_404
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.errors import EdsError, ParameterError

BAR = 1e5
SPAN = (0.0, 250 * BAR)
PDOS = range(0x1400, 0x1C00)
UNIT_BAR, UNIT_KPA, UNIT_PSI = 0x004E0000, 0x03220000, 0x00AB0000
# CiA 303-2: the power of ten as a signed byte (0xFD is -3), then the unit: 0x22 pascal, 0x4E bar.
UNIT_PA, UNIT_HPA, UNIT_MPA, UNIT_MBAR = 0x00220000, 0x02220000, 0x06220000, 0xFD4E0000


def fit_transducer(rig):
    rig.device = PressureDevice(rig.node, SPAN)
    apply(rig, 0.0)
    return rig


@pytest.fixture
def rig(make_rig):
    return fit_transducer(make_rig(PRESSURE_404))


def apply(rig, pressure):
    """Let the transducer measure this pressure [Pa] from now on, and run one tick."""
    rig.work = lambda now: rig.device.publish(pressure, now)
    rig.tick()


def values(rig):
    return rig.value(0x6130, 1), rig.value(0x7130, 1), rig.value(0x9130, 1)


@pytest.mark.parametrize(
    ("pressure", "expected"),
    # bar, and times 10^2 (0x6132.01 is 2) as integers
    [
        (0.0, (0.0, 0, 0)),
        (100 * BAR, (100.0, 10000, 10000)),
        (123.456 * BAR, (123.456, 12346, 12346)),
        (-1.234 * BAR, (-1.234, -123, -123)),
        (257.8 * BAR, (257.8, 25780, 25780)),
        (-7.8 * BAR, (-7.8, -780, -780)),
    ],
)
def test_the_process_value_in_three_formats(rig, pressure, expected):
    apply(rig, pressure)
    assert values(rig) == pytest.approx(expected)
    assert rig.value(0x6150, 1) == 0


@pytest.mark.parametrize(
    ("unit", "digits", "expected"),
    # 100 bar = 10,000 kPa = 1450.3774 psi
    [
        (UNIT_BAR, 0, (100.0, 100, 100)),
        (UNIT_BAR, 1, (100.0, 1000, 1000)),
        (UNIT_KPA, 0, (10000.0, 10000, 10000)),
        (UNIT_PSI, 1, (1450.37738, 14504, 14504)),
        # and = 10 MPa = 100,000 hPa = 100,000 mbar = 10,000,000 Pa
        (UNIT_MPA, 3, (10.0, 10000, 10000)),
        (UNIT_HPA, 0, (100000.0, -32768, 100000)),
        (UNIT_MBAR, 0, (100000.0, -32768, 100000)),
        (UNIT_PA, 0, (10000000.0, -32768, 10000000)),
        # Too large for INTEGER16 only: that format has no value.
        (UNIT_BAR, 3, (100.0, -32768, 100000)),
        (UNIT_KPA, 3, (10000.0, -32768, 10000000)),
    ],
)
def test_unit_and_digits(rig, unit, digits, expected):
    assert rig.write(0x6131, 1, unit, 4) is None
    assert rig.write(0x6132, 1, digits, 1) is None
    apply(rig, 100 * BAR)
    assert values(rig) == pytest.approx(expected)
    assert rig.value(0x6150, 1) == 0


@pytest.mark.parametrize(
    ("pressure", "int16"), [(3276.7e3, 32767), (3276.74e3, 32767), (3276.76e3, -32768)]
)
def test_the_integer_format_ends_at_its_last_value(rig, pressure, int16):
    assert rig.write(0x6131, 1, UNIT_KPA, 4) is None
    assert rig.write(0x6132, 1, 1, 1) is None
    apply(rig, pressure)
    assert rig.value(0x7130, 1) == int16


@pytest.mark.parametrize(
    ("unit", "end"),
    [
        *((UNIT_BAR, 250.0), (UNIT_KPA, 25000.0), (UNIT_PSI, 3625.94344)),
        *((UNIT_PA, 25e6), (UNIT_HPA, 250e3), (UNIT_MPA, 25.0), (UNIT_MBAR, 250e3)),
    ],
)
def test_the_span_is_shown_in_the_unit(rig, unit, end):
    assert rig.write(0x6131, 1, unit, 4) is None
    assert rig.value(0x6148, 1) == 0.0
    assert rig.value(0x6149, 1) == pytest.approx(end)


@pytest.mark.parametrize(
    ("pressure", "status"),
    [
        (257.82 * BAR, 0x03),
        (math.inf, 0x03),
        (-7.82 * BAR, 0x05),
        (-math.inf, 0x05),
        (math.nan, 0x01),
    ],
)
def test_an_overload_has_no_value(rig, pressure, status):
    apply(rig, 100 * BAR)
    apply(rig, pressure)
    process_value, int16, int32 = values(rig)
    assert math.isnan(process_value)
    assert (int16, int32) == (-32768, -2147483648)
    assert rig.value(0x6150, 1) == status


def test_an_overload_sends_one_emcy_and_its_end_takes_it_back(rig):
    apply(rig, 300 * BAR)
    rig.tick(20)
    apply(rig, -300 * BAR)
    # Code F001h, error register: generic (bit 0) and device profile specific (bit 5).
    assert [data[:3] for data in rig.sent(0x085)] == [bytes.fromhex("01f0 21")]
    assert rig.value(0x1001) == 0x21
    apply(rig, 100 * BAR)
    assert rig.emcy_codes() == [0x0000]
    assert values(rig) == pytest.approx((100.0, 10000, 10000))
    assert (rig.value(0x1001), rig.value(0x6150, 1)) == (0, 0)


def test_the_unit_does_not_move_the_overload_limits(rig):
    assert rig.write(0x6131, 1, UNIT_PSI, 4) is None
    apply(rig, 257.8 * BAR)
    assert rig.value(0x6150, 1) == 0
    apply(rig, 257.82 * BAR)
    assert rig.value(0x6150, 1) == 0x03


def test_tpdo1_carries_the_process_value_and_the_status_every_10_ms(rig):
    rig.nmt(rig.START)
    apply(rig, 100 * BAR)
    rig.sent(0x185)
    rig.tick(20)
    assert rig.sent(0x185) == [struct.pack("<fB", 100.0, 0)] * 2


def test_tpdo1_carries_nan_in_an_overload(rig):
    rig.nmt(rig.START)
    apply(rig, 300 * BAR)
    value, status = struct.unpack("<fB", rig.sent(0x185)[-1])
    assert math.isnan(value)
    assert status == 0x03


@pytest.mark.parametrize(
    ("index", "value", "size", "abort"),
    [
        (0x6131, 0x002D0000, 4, 0x06090030),  # °C
        (0x6131, 0x00000000, 4, 0x06090030),
        (0x6132, 4, 1, 0x06090031),
        (0x6130, 0, 4, 0x06010002),
        (0x6148, 0, 4, 0x06010002),
        (0x6149, 0, 4, 0x06010002),
        (0x6150, 0, 1, 0x06010002),
    ],
)
def test_writes_are_checked(rig, index, value, size, abort):
    assert rig.write(index, 1, value, size) == abort
    assert (rig.value(0x6131, 1), rig.value(0x6132, 1)) == (UNIT_BAR, 2)


def test_a_node_reset_brings_the_default_unit_back(rig):
    assert rig.write(0x6131, 1, UNIT_KPA, 4) is None
    rig.nmt(rig.RESET_NODE)
    apply(rig, 100 * BAR)
    assert values(rig) == pytest.approx((100.0, 10000, 10000))
    assert rig.value(0x6149, 1) == 250.0


def test_an_overload_outlives_a_node_reset(rig):
    apply(rig, 300 * BAR)
    rig.nmt(rig.RESET_NODE)
    rig.tick(2)
    assert rig.value(0x6150, 1) == 0x03
    assert rig.emcy_codes() == [0xF001, 0xF001]


@pytest.mark.parametrize(
    "span", [(0.0, 0.0), (1e5, 0.0), (0.0, math.inf), (math.nan, 1e5), (0.0, math.nan)]
)
def test_an_impossible_span_is_refused(make_rig, span):
    with pytest.raises(ParameterError, match="span is"):
        PressureDevice(make_rig(PRESSURE_404).node, span)


@pytest.mark.parametrize("index", [0x6130, 0x6131, 0x6150])
def test_an_eds_without_a_needed_object_is_refused(make_rig, index):
    rig = make_rig(PRESSURE_404, without={*PDOS, index})
    with pytest.raises(EdsError, match=rf"pressure_404\.eds: object 0x{index:04X}\.01"):
        PressureDevice(rig.node, SPAN)


def test_the_smallest_object_set_works(make_rig):
    optional = {0x6132, 0x6148, 0x6149, 0x7130, 0x9130}
    rig = fit_transducer(make_rig(PRESSURE_404, without=optional))
    apply(rig, 100 * BAR)
    assert rig.value(0x6130, 1) == 100.0
    apply(rig, 300 * BAR)
    assert rig.value(0x6150, 1) == 0x03


def test_a_default_unit_that_is_no_pressure_is_refused(make_rig, make_file):
    eds = make_file("other.eds", PRESSURE_404.read_text().replace("0x004E0000", "0x002D0000"))
    with pytest.raises(EdsError, match=r"object 0x6131\.01 .* is 0x002D0000; the units are"):
        PressureDevice(make_rig(eds).node, SPAN)


def test_digits_are_checked_where_the_eds_has_no_limit(make_rig, make_file):
    limits = "LowLimit=0\nHighLimit=3\nDefaultValue=2\n"
    text = PRESSURE_404.read_text()
    assert text.count(limits) == 1
    eds = make_file("other.eds", text.replace(limits, "DefaultValue=2\n"))
    rig = fit_transducer(make_rig(eds))
    assert rig.write(0x6132, 1, 4, 1) == 0x06090031
    assert rig.write(0x6132, 1, 3, 1) is None


def test_a_span_that_the_eds_lets_write_is_still_the_transducers_own(make_rig, make_file):
    text = PRESSURE_404.read_text()
    head = "[6149sub1]\nParameterName=AI span end 1\nObjectType=0x7\nDataType=0x0008\n"
    assert head + "AccessType=ro" in text
    eds = make_file("other.eds", text.replace(head + "AccessType=ro", head + "AccessType=rw"))
    rig = fit_transducer(make_rig(eds))
    assert rig.write(0x6149, 1, 0x42C80000, 4) == 0x06010002
    assert rig.value(0x6149, 1) == 250.0
