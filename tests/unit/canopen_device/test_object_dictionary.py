import math

import pytest

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import REAL32, UNSIGNED8, UNSIGNED16
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable


@pytest.fixture
def dictionary():
    return ObjectDictionary(
        [
            Variable(0x2000, 0, "Mode", UNSIGNED8, default=3, low=1, high=10),
            Variable(0x2001, 0, "Version", UNSIGNED16, access=Access.CONST, default=0x0102),
            Variable(0x2002, 0, "Key", UNSIGNED16, access=Access.WO),
            Variable(0x2003, 1, "Gain", REAL32, default=1.0, high=2.0),
            Variable(0x2004, 0, "Free", UNSIGNED16),
        ]
    )


def abort_code(call, *arguments):
    with pytest.raises(SdoAbort) as refused:
        call(*arguments)
    return refused.value.code


# Codes: CiA 301, SDO abort codes.
@pytest.mark.parametrize(
    ("index", "subindex", "code"),
    [
        (0x2999, 0, 0x06020000),
        (0x2000, 1, 0x06090011),  # sub-index of a VAR
        (0x2003, 0, 0x06090011),
        (0x2002, 0, 0x06010001),
    ],
)
def test_upload_refused(dictionary, index, subindex, code):
    assert abort_code(dictionary.upload, index, subindex) == code


@pytest.mark.parametrize(
    ("index", "subindex", "raw", "code"),
    [
        (0x2999, 0, "00", 0x06020000),
        (0x2003, 2, "00", 0x06090011),
        (0x2001, 0, "0000", 0x06010002),
        (0x2000, 0, "0000", 0x06070012),
        (0x2002, 0, "00", 0x06070013),
        (0x2000, 0, "0b", 0x06090031),
        (0x2000, 0, "00", 0x06090032),
        (0x2003, 1, "0000c07f", 0x06090030),  # NaN
    ],
)
def test_download_refused(dictionary, index, subindex, raw, code):
    assert abort_code(dictionary.download, index, subindex, bytes.fromhex(raw)) == code
    assert [variable.value for variable in dictionary] == [3, 0x0102, 0, 1.0, 0]


def test_upload_encodes_the_present_value(dictionary):
    dictionary.variable(0x2004).value = 0x1234
    assert dictionary.upload(0x2004, 0) == b"\x34\x12"


def test_upload_without_data(dictionary):
    dictionary.variable(0x2004).value = None
    assert abort_code(dictionary.upload, 0x2004, 0) == 0x08000024


def test_limits_are_inclusive(dictionary):
    for value in (1, 10):
        dictionary.download(0x2000, 0, bytes([value]))
        assert dictionary.variable(0x2000).value == value


def test_check_sees_the_value_before_and_hook_after_the_write(dictionary):
    variable = dictionary.variable(0x2004)
    seen = []
    dictionary.add_check(0x2004, 0, lambda value: seen.append(("check", value, variable.value)))
    dictionary.add_hook(0x2004, 0, lambda value: seen.append(("hook", value, variable.value)))

    dictionary.download(0x2004, 0, b"\x07\x00")

    assert seen == [("check", 7, 0), ("hook", 7, 7)]


def test_check_refuses(dictionary):
    def refuse(_value):
        raise SdoAbort(*abort_codes.DEVICE_STATE)

    hooked = []
    dictionary.add_check(0x2004, 0, refuse)
    dictionary.add_hook(0x2004, 0, hooked.append)

    assert abort_code(dictionary.download, 0x2004, 0, b"\x07\x00") == 0x08000022
    assert dictionary.variable(0x2004).value == 0
    assert hooked == []


def test_plain_until_something_stands_between(dictionary):
    variable = dictionary.variable(0x2004)
    assert variable.is_plain
    assert not dictionary.variable(0x2000).is_plain  # limits
    dictionary.add_hook(0x2004, 0, print)
    assert not variable.is_plain


def test_restore_is_for_a_range_and_tells_no_hook(dictionary):
    hooked = []
    dictionary.add_hook(0x2000, 0, hooked.append)
    dictionary.variable(0x2000).value = 9
    dictionary.variable(0x2004).value = 9

    dictionary.restore(range(0x2000, 0x2004))

    assert dictionary.variable(0x2000).value == 3
    assert dictionary.variable(0x2004).value == 9
    assert hooked == []


def test_infinity_is_above_a_high_limit_and_fine_below_none(dictionary):
    variable = dictionary.variable(0x2003, 1)
    assert abort_code(variable.write, math.inf) == 0x06090031
    variable.write(-math.inf)
    assert variable.value == -math.inf


@pytest.mark.parametrize(
    ("access", "readable", "writable", "in_tpdo", "in_rpdo"),
    [  # CiA 306, AccessType: rwr is a process input, rww a process output.
        (Access.RO, True, False, True, False),
        (Access.WO, False, True, False, True),
        (Access.RW, True, True, True, True),
        (Access.RWR, True, True, True, False),
        (Access.RWW, True, True, False, True),
        (Access.CONST, True, False, True, False),
    ],
)
def test_access(access, readable, writable, in_tpdo, in_rpdo):
    assert (access.readable, access.writable) == (readable, writable)
    assert (access.in_tpdo, access.in_rpdo) == (in_tpdo, in_rpdo)


def test_number_of_an_absent_object(dictionary):
    assert dictionary.number(0x2000) == 3
    assert dictionary.number(0x2999) == 0
    assert dictionary.number(0x2999, absent=4) == 4


def test_a_dictionary_that_comes_from_no_file_says_nothing_of_one():
    dictionary = ObjectDictionary([])
    assert (dictionary.source, dictionary.findings, dictionary.claims_lss) == ("", (), False)
