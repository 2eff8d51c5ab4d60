import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device import datatypes
from hil_bench.canopen_device.datatypes import DATA_TYPES, IntegerType
from hil_bench.canopen_device.errors import SdoAbort

INTEGERS = [t for t in DATA_TYPES.values() if isinstance(t, IntegerType)]


@pytest.mark.parametrize("bits", [8, 16, 24, 32, 40, 48, 56, 64])
def test_integers_have_the_ranges_of_twos_complement(bits):
    kinds = {kind.signed: kind for kind in INTEGERS if kind.size == bits // 8}
    assert (kinds[True].low, kinds[True].high) == (-(2**bits) // 2, 2**bits // 2 - 1)
    if False in kinds:
        assert (kinds[False].low, kinds[False].high) == (0, 2**bits - 1)


@pytest.mark.parametrize(
    ("data_type", "value", "raw"),
    [
        # Little endian, two's complement (CiA 301, transfer syntax), worked out by hand.
        (datatypes.BOOLEAN, True, "01"),
        (datatypes.INTEGER8, -128, "80"),
        (datatypes.INTEGER16, -2, "feff"),
        (datatypes.INTEGER24, -2, "feffff"),
        (datatypes.INTEGER24, 0x123456, "563412"),
        (datatypes.INTEGER32, -(2**31), "00000080"),
        (datatypes.INTEGER64, -1, "ffffffffffffffff"),
        (datatypes.UNSIGNED8, 255, "ff"),
        (datatypes.UNSIGNED16, 0x1234, "3412"),
        (datatypes.UNSIGNED24, 0xABCDEF, "efcdab"),
        (datatypes.UNSIGNED32, 0x12345678, "78563412"),
        (datatypes.UNSIGNED64, 2**64 - 2, "feffffffffffffff"),
        # IEEE 754: 1.5 = 0x3FC00000, -2.5 = 0xC004000000000000.
        (datatypes.REAL32, 1.5, "0000c03f"),
        (datatypes.REAL64, -2.5, "00000000000004c0"),
        (datatypes.VISIBLE_STRING, "a~ ", "617e20"),
        (datatypes.OCTET_STRING, b"\x00\xff", "00ff"),
        (datatypes.UNICODE_STRING, "aé", "6100e900"),
        (datatypes.DOMAIN, b"\x01", "01"),
        # 3 600 000 ms after midnight, day 16 384: 0x0036EE80 and 0x4000.
        (datatypes.TIME_OF_DAY, 0x4000_0036_EE80, "80ee36000040"),
        (datatypes.TIME_DIFFERENCE, 1, "010000000000"),
    ],
)
def test_value_on_the_bus(data_type, value, raw):
    assert data_type.encode(value) == bytes.fromhex(raw)
    assert data_type.decode(bytes.fromhex(raw)) == value


@pytest.mark.parametrize("data_type", INTEGERS, ids=repr)
def test_integer_range_is_that_of_its_bits(data_type):
    assert data_type.high - data_type.low == 2**data_type.bits - 1
    assert (data_type.low < 0) == data_type.name.startswith("INTEGER")
    for outside in (data_type.low - 1, data_type.high + 1):
        with pytest.raises(OverflowError):
            data_type.encode(outside)


@given(data=st.data())
@pytest.mark.parametrize("data_type", INTEGERS, ids=repr)
def test_integer_round_trip(data_type, data):
    value = data.draw(st.integers(data_type.low, data_type.high))
    assert data_type.decode(data_type.encode(value)) == value


def test_real_range_is_the_largest_finite_number():
    # IEEE 754-2008 table 3.5: (2 - 2^-23) x 2^127 and (2 - 2^-52) x 2^1023.
    assert datatypes.REAL32.high == (2 - 2**-23) * 2.0**127
    assert datatypes.REAL64.high == (2 - 2**-52) * 2.0**1023
    with pytest.raises(OverflowError):
        datatypes.REAL32.encode(1e39)


def test_real_carries_nan_and_infinity():
    assert math.isnan(datatypes.REAL32.decode(datatypes.REAL32.encode(math.nan)))
    assert datatypes.REAL32.decode(datatypes.REAL32.encode(-math.inf)) == -math.inf


@pytest.mark.parametrize("data_type", [t for t in DATA_TYPES.values() if t.size], ids=repr)
def test_length_is_checked(data_type):
    with pytest.raises(SdoAbort) as long:
        data_type.decode(bytes(data_type.size + 1))
    with pytest.raises(SdoAbort) as short:
        data_type.decode(bytes(data_type.size - 1))
    assert (long.value.code, short.value.code) == (0x06070012, 0x06070013)


@pytest.mark.parametrize(
    ("data_type", "raw", "code"),
    [
        (datatypes.VISIBLE_STRING, b"\x1f", 0x06090030),
        (datatypes.VISIBLE_STRING, b"\x7f", 0x06090030),
        (datatypes.UNICODE_STRING, b"abc", 0x06070010),
        (datatypes.UNICODE_STRING, b"\x00\xd8", 0x06090030),  # half of a surrogate pair
    ],
)
def test_string_that_is_none(data_type, raw, code):
    with pytest.raises(SdoAbort) as refused:
        data_type.decode(raw)
    assert refused.value.code == code


def test_bytes_type_takes_bytes_only():
    with pytest.raises(TypeError, match="holds bytes"):
        datatypes.DOMAIN.encode("text")


def test_codes_are_those_of_cia_301():
    codes = {0x1: "BOOLEAN", 0x4: "INTEGER32", 0x8: "REAL32", 0x16: "UNSIGNED24", 0xF: "DOMAIN"}
    assert {code: DATA_TYPES[code].name for code in codes} == codes
