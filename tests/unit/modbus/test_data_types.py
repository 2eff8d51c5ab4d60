"""How numbers stand in registers."""

import math

import pytest

from hil_bench.abilities.modbus.protocol.register_map import DATA_TYPES, WordOrder

BIG, LITTLE = WordOrder.BIG, WordOrder.LITTLE


# IEEE 754: 1.5 is 3FC00000, -0.1 rounded to single BDCCCCCD; two's complement for the integers.
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("float32", 1.5, (0x3FC0, 0x0000)),
        ("float32", -0.1, (0xBDCC, 0xCCCD)),
        ("int32", -2, (0xFFFF, 0xFFFE)),
        ("int32", 65538, (0x0001, 0x0002)),
        ("uint32", 4294967295, (0xFFFF, 0xFFFF)),
        ("int16", -1, (0xFFFF,)),
        ("uint16", 65535, (0xFFFF,)),
    ],
)
def test_a_value_and_its_registers(name, value, words):
    data_type = DATA_TYPES[name]
    assert data_type.encode(value, BIG) == words
    assert data_type.encode(value, LITTLE) == words[::-1]
    assert data_type.decode(words, BIG) == pytest.approx(value, rel=1e-7)
    assert data_type.decode(words[::-1], LITTLE) == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("int16", 40000, (0x7FFF,)),
        ("int16", -40000, (0x8000,)),
        ("uint16", -1, (0x0000,)),
        ("uint16", math.inf, (0xFFFF,)),
        ("int32", 1e30, (0x7FFF, 0xFFFF)),
        ("float32", 1e300, (0x7F7F, 0xFFFF)),
        ("float32", -math.inf, (0xFF7F, 0xFFFF)),
    ],
)
def test_what_does_not_fit_stands_at_the_end(name, value, words):
    assert DATA_TYPES[name].encode(value, BIG) == words


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("int16", (0x8000,)),
        ("int32", (0x8000, 0)),
        ("uint16", (0xFFFF,)),
        ("uint32", (0xFFFF, 0xFFFF)),
    ],
)
def test_no_number_has_a_mark_in_an_integer(name, words):
    assert DATA_TYPES[name].encode(math.nan, BIG) == words


def test_no_number_is_nan_in_a_float():
    words = DATA_TYPES["float32"].encode(math.nan, BIG)
    assert math.isnan(DATA_TYPES["float32"].decode(words, BIG))
