import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device import datatypes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import (
    Direction,
    MappingEntry,
    PdoMapping,
    find_refusal,
)

TYPES = (
    datatypes.UNSIGNED16,
    datatypes.INTEGER16,
    datatypes.UNSIGNED24,
    datatypes.BOOLEAN,
    datatypes.REAL32,
    datatypes.INTEGER24,
    datatypes.UNSIGNED64,
    datatypes.INTEGER8,
)


@pytest.fixture(scope="module")
def dictionary():
    """One mappable rw variable of each type: 0x2000 + its place in TYPES."""
    variables = [
        Variable(0x2000 + offset, 0, data_type.name, data_type, mappable=True)
        for offset, data_type in enumerate(TYPES)
    ]
    text = Variable(0x2100, 0, "Text", datatypes.VISIBLE_STRING, mappable=True)
    write_only = Variable(0x2101, 0, "Key", datatypes.UNSIGNED8, access=Access.WO, mappable=True)
    return ObjectDictionary([*variables, text, write_only])


def entry_of(data_type):
    return MappingEntry(0x2000 + TYPES.index(data_type), 0, data_type.bits)


def test_entry_from_its_raw_value():
    # CiA 301, mapping parameter: bits 31-16 index, 15-8 sub-index, 7-0 length.
    assert MappingEntry.parse(0x63000110) == MappingEntry(0x6300, 1, 16)
    assert str(MappingEntry.parse(0x63000110)) == "0x6300.01 (16 bit)"


@pytest.mark.parametrize(
    ("types", "values", "data"),
    [
        # Little endian, the first entry in the lowest bits (CiA 301, PDO mapping), by hand.
        ((datatypes.UNSIGNED16, datatypes.INTEGER16), (0x1234, -2), "3412feff"),
        ((datatypes.REAL32,), (1.5,), "0000c03f"),
        ((datatypes.UNSIGNED64,), (2**64 - 2,), "feffffffffffffff"),
        ((datatypes.UNSIGNED24, datatypes.INTEGER24), (0x010203, -2), "030201feffff"),
        ((datatypes.BOOLEAN, datatypes.INTEGER8), (True, -1), "ff01"),
        ((datatypes.INTEGER8, datatypes.BOOLEAN), (3, True), "0301"),
        ((datatypes.BOOLEAN, datatypes.REAL32), (False, 1.5), "0000807f00"),
    ],
)
def test_layout(dictionary, types, values, data):
    mapping = PdoMapping(dictionary, [entry_of(t) for t in types], Direction.TPDO)
    assert mapping.length == len(bytes.fromhex(data))

    for variable, value in zip(mapping.variables, values, strict=True):
        variable.value = value
    assert mapping.read() == bytes.fromhex(data)

    for variable in mapping.variables:
        variable.value = variable.default
    assert mapping.write(bytes.fromhex(data)) == 0
    assert tuple(variable.value for variable in mapping.variables) == values


@given(data=st.binary(min_size=8, max_size=8))
def test_packed_and_bitwise_paths_agree(dictionary, data):
    types = (datatypes.UNSIGNED16, datatypes.INTEGER8, datatypes.REAL32)
    mapping = PdoMapping(dictionary, [entry_of(t) for t in types], Direction.RPDO)
    mapping.write(data)
    packed = mapping.read()
    mapping._write_bits(data)
    assert mapping._read_bits() == packed


def test_dummy_takes_its_place_and_is_dropped(dictionary):
    entries = [MappingEntry(0x0006, 0, 16), entry_of(datatypes.INTEGER8)]
    mapping = PdoMapping(dictionary, entries, Direction.RPDO)
    mapping.write(bytes.fromhex("aaaa05"))
    assert [variable.value for variable in mapping.variables] == [5]


@pytest.mark.parametrize("guard", [{"low": 1}, {"high": 6}, "check", "hook"])
def test_each_guard_alone_stands_before_the_value(guard):
    """A limit, a check and a hook; what a hook refuses has been written."""
    limits = guard if isinstance(guard, dict) else {}
    variable = Variable(0x2000, 0, "a", datatypes.UNSIGNED8, mappable=True, default=3, **limits)

    def refuse(_value):
        raise SdoAbort(0x08000020, "not now")

    if not limits:
        {"check": variable.add_check, "hook": variable.add_hook}[guard](refuse)
    entries = [MappingEntry(0x2000, 0, 8)]
    mapping = PdoMapping(ObjectDictionary([variable]), entries, Direction.RPDO)
    value = 0 if guard == {"low": 1} else 7
    assert mapping.write(bytes([value])) == 1
    assert variable.value == (value if guard == "hook" else 3)


def test_refused_value_leaves_the_others():
    limited = Variable(0x2000, 0, "a", datatypes.UNSIGNED8, high=10, mappable=True)
    free = Variable(0x2001, 0, "b", datatypes.UNSIGNED8, mappable=True)
    entries = [MappingEntry(0x2000, 0, 8), MappingEntry(0x2001, 0, 8)]
    mapping = PdoMapping(ObjectDictionary([limited, free]), entries, Direction.RPDO)

    assert mapping.write(b"\x0b\x07") == 1
    assert (limited.value, free.value) == (0, 7)


@pytest.mark.parametrize(
    ("entry", "direction", "code"),
    [
        (MappingEntry(0x3000, 0, 8), Direction.TPDO, 0x06020000),
        (MappingEntry(0x2000, 1, 16), Direction.TPDO, 0x06090011),
        (MappingEntry(0x2000, 0, 8), Direction.TPDO, 0x06040041),
        (MappingEntry(0x2100, 0, 8), Direction.TPDO, 0x06040041),
        (MappingEntry(0x2101, 0, 8), Direction.TPDO, 0x06040041),
        (MappingEntry(0x0005, 0, 8), Direction.TPDO, 0x06040041),
        (MappingEntry(0x0005, 0, 16), Direction.RPDO, 0x06040041),
    ],
)
def test_entry_refused(dictionary, entry, direction, code):
    assert find_refusal(dictionary, entry, direction).abort[0] == code
    with pytest.raises(SdoAbort) as refused:
        PdoMapping(dictionary, [entry], direction)
    assert refused.value.code == code


def test_more_than_64_bit_refused(dictionary):
    entries = [entry_of(datatypes.UNSIGNED64), entry_of(datatypes.BOOLEAN)]
    with pytest.raises(SdoAbort) as refused:
        PdoMapping(dictionary, entries, Direction.TPDO)
    assert refused.value.code == 0x06040042
