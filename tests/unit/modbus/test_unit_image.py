"""What a unit shows of a row, and what may be written."""

import math
import pickle

import pytest
from support.registers import register

from hil_bench.abilities.modbus.protocol.register_map import (
    DATA_TYPES,
    Assignment,
    DeviceIdentification,
    ExceptionCode,
    Holes,
    ModbusException,
    RegisterAccess,
    RegisterMap,
    Table,
    WordOrder,
)
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage, find_rivals
from hil_bench.units import BAR, MILLISECOND

FLOAT32, INT16, UINT16 = DATA_TYPES["float32"], DATA_TYPES["int16"], DATA_TYPES["uint16"]
INPUTS, HOLDING, COILS = Table.INPUT_REGISTERS, Table.HOLDING_REGISTERS, Table.COILS

WRITE, COMMAND = RegisterAccess.WRITE, RegisterAccess.COMMAND

MAP = RegisterMap(
    "map.toml",
    "pressure_404",
    DeviceIdentification("maker", "code", "1.0"),
    (
        register("on", COILS, 0, "on", WRITE),
        register("go", COILS, 1, "go", COMMAND),
        register("p", INPUTS, 10, "p", data_type=FLOAT32, unit=BAR),
        register("q", INPUTS, 12, "p", data_type=INT16, unit=BAR, scale=0.01),
        register("far", INPUTS, 20, "p", data_type=UINT16),
        register("set", HOLDING, 0, "set", COMMAND, data_type=FLOAT32, low=-1.0, high=1.0),
        register("time", HOLDING, 2, "t", WRITE, data_type=UINT16, unit=MILLISECOND),
        register("fixed", HOLDING, 3, "f", data_type=UINT16),
    ),
)
FIRST = 5  # somebody else's five values stand before
ROW = [9.0] * FIRST + [1.0, 0.0, 150e5, 150e5, 7.0, 0.5, 0.25, 3.0]


def image(*, commands=True, holes=Holes.REFUSE):
    # As the server's process gets it.
    unit = UnitImage(MAP, FIRST, commands=commands, holes=holes)
    return pickle.loads(pickle.dumps(unit))  # noqa: S301


def refusal(act):
    with pytest.raises(ModbusException) as caught:
        act()
    return caught.value.code


def test_values_are_read_in_their_units():
    # 150 bar is 43160000 as a float, and 15000 times 0.01 bar.
    assert image().read(INPUTS, 10, 3, 1, ROW) == [0x4316, 0x0000, 15000]
    assert image().read(COILS, 0, 2, 1, ROW) == [1, 0]
    assert image().read(HOLDING, 2, 2, 1, ROW) == [250, 3]


def test_a_new_row_shows_new_values_and_the_same_row_the_same():
    unit = image()
    unit.read(INPUTS, 12, 1, 1, ROW)
    changed = [*ROW[:7], 1e5, 1e5, *ROW[9:]]
    assert unit.read(INPUTS, 12, 1, 1, changed) == [15000]
    assert unit.read(INPUTS, 12, 1, 2, changed) == [100]


@pytest.mark.parametrize(
    ("address", "count"),
    [(10, 1), (11, 1), (11, 2), (9, 3), (12, 2), (12, 9), (13, 1), (65535, 2), (0, 1)],
)
def test_half_a_value_or_none_is_an_illegal_address(address, count):
    code = refusal(lambda: image().read(INPUTS, address, count, 1, ROW))
    assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS


def test_a_write_assigns_what_stands_there_in_si():
    assert image().parse_write(HOLDING, 0, [0x3F00, 0, 100]) == [
        Assignment(FIRST + 5, 0.5),
        Assignment(FIRST + 6, pytest.approx(0.1)),
    ]
    assert image().parse_write(COILS, 0, [0, 1]) == [
        Assignment(FIRST, 0.0),
        Assignment(FIRST + 1, 1.0),
    ]


@pytest.mark.parametrize(
    ("table", "address", "words"),
    [
        (HOLDING, 0, [0x3F00]),
        (HOLDING, 1, [0, 100]),
        (HOLDING, 2, [100, 1]),
        (HOLDING, 3, [1]),
        (HOLDING, 7, [1]),
        (COILS, 1, [1, 1]),
    ],
)
def test_a_write_of_half_a_value_or_of_what_is_fixed_is_an_illegal_address(table, address, words):
    code = refusal(lambda: image().parse_write(table, address, words))
    assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS


@pytest.mark.parametrize("words", [[0x3F80, 0x0001], [0x7FC0, 0], [0x7F80, 0], [0xFF80, 0]])
def test_a_value_out_of_range_or_none_is_an_illegal_value(words):
    # Just above 1.0, NaN, and both infinities.
    code = refusal(lambda: image().parse_write(HOLDING, 0, words))
    assert code is ExceptionCode.ILLEGAL_DATA_VALUE


def test_commands_need_permission():
    without = image(commands=False)
    for table, address, words in ((HOLDING, 0, [0, 0]), (COILS, 1, [1])):
        code = refusal(lambda t=table, a=address, w=words: without.parse_write(t, a, w))
        assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS
    assert without.parse_write(COILS, 0, [1]) == [Assignment(FIRST, 1.0)]


def test_a_mask_changes_a_register_that_may_be_written():
    # The masks of the specification's example, 6.16.
    assert image().parse_mask(2, 0xF2, 0x25) == [
        Assignment(FIRST + 6, 0xF2 << 16 | 0x25, is_mask=True)
    ]


@pytest.mark.parametrize("address", [0, 1, 3, 7])
def test_a_mask_for_half_a_value_or_for_what_is_fixed_is_an_illegal_address(address):
    code = refusal(lambda: image().parse_mask(address, 0, 0))
    assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS


def test_holes_are_zeros_where_that_is_wanted():
    unit = image(holes=Holes.ZERO)
    assert unit.read(INPUTS, 8, 14, 1, ROW) == [0, 0, 0x4316, 0, 15000, *[0] * 7, 7, 0]
    assert unit.read(INPUTS, 100, 3, 1, ROW) == [0, 0, 0]
    assert unit.read(COILS, 0, 8, 1, ROW) == [1, 0, 0, 0, 0, 0, 0, 0]
    assert unit.read(Table.DISCRETE_INPUTS, 65528, 8, 1, ROW) == [0] * 8


@pytest.mark.parametrize(("address", "count"), [(10, 1), (11, 1), (11, 4), (9, 2), (65535, 2)])
def test_half_a_value_is_an_illegal_address_beside_holes_too(address, count):
    code = refusal(lambda: image(holes=Holes.ZERO).read(INPUTS, address, count, 1, ROW))
    assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS


def test_what_is_written_into_holes_does_nothing():
    unit = image(holes=Holes.ZERO)
    assert unit.parse_write(COILS, 0, [0, 1, 1, 1, 1, 1, 1, 1]) == [
        Assignment(FIRST, 0.0),
        Assignment(FIRST + 1, 1.0),
    ]
    assert unit.parse_write(HOLDING, 4, [1, 2, 3]) == []
    assert unit.parse_mask(4, 0, 1) == []


@pytest.mark.parametrize(
    ("address", "words"), [(0, [0x3F00]), (1, [0, 100]), (2, [100, 1]), (65535, [1, 1])]
)
def test_holes_make_nothing_writable_that_is_not(address, words):
    code = refusal(lambda: image(holes=Holes.ZERO).parse_write(HOLDING, address, words))
    assert code is ExceptionCode.ILLEGAL_DATA_ADDRESS


def test_registers_that_give_the_same_command_are_rivals():
    # "p" stands twice, but only to be read.
    assert image().rivals == {}
    registers = [
        (10, register("a", HOLDING, 0, "enable", COMMAND)),
        (11, register("b", COILS, 0, "control_word", WRITE)),
        (12, register("c", COILS, 1, "0x604f", WRITE)),
        (13, register("d", COILS, 2, "0x604F.00", WRITE)),
        (14, register("e", COILS, 3, "0x604F.01", WRITE)),
    ]
    assert find_rivals(registers) == {10: 10, 11: 10, 12: 12, 13: 12}


def test_the_older_notation_tells_the_table_by_its_first_digit():
    references = {register.name: register.reference for register in MAP.registers}
    assert (references["on"], references["p"], references["set"]) == (1, 30011, 40001)


# How numbers stand in registers.


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


def test_what_does_not_fit_stands_at_the_end():
    expected = {
        ("int16", 40000): (0x7FFF,),
        ("int16", -40000): (0x8000,),
        ("uint16", -1): (0x0000,),
        ("uint16", math.inf): (0xFFFF,),
        ("int32", 1e30): (0x7FFF, 0xFFFF),
        ("float32", 1e300): (0x7F7F, 0xFFFF),
        ("float32", -math.inf): (0xFF7F, 0xFFFF),
    }
    assert {
        (name, value): DATA_TYPES[name].encode(value, BIG) for name, value in expected
    } == expected


def test_no_number_has_a_mark_in_an_integer():
    expected = {
        "int16": (0x8000,),
        "int32": (0x8000, 0),
        "uint16": (0xFFFF,),
        "uint32": (0xFFFF, 0xFFFF),
    }
    assert {name: DATA_TYPES[name].encode(math.nan, BIG) for name in expected} == expected


def test_no_number_is_nan_in_a_float():
    words = DATA_TYPES["float32"].encode(math.nan, BIG)
    assert math.isnan(DATA_TYPES["float32"].decode(words, BIG))
