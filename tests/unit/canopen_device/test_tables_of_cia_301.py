"""The data types and the predefined COB-IDs of CiA 301, entry by entry."""

import sys

import pytest

from hil_bench.canopen_device.datatypes import REAL32, REAL64
from hil_bench.canopen_device.eds_checks import required_type
from hil_bench.canopen_device.eds_entries import predefined_default

OFF = 0x80000000, 0
# By index: the types of sub-indices 0, 1, ...; the last goes on. CiA 301, 7.5.2; 0x1F80: CiA 302-2.
U8, U16, U32 = "UNSIGNED8", "UNSIGNED16", "UNSIGNED32"
PARAMETERS = (U8, U32, U8, U16, U8, U16, U8, None)
TYPES = {
    **dict.fromkeys((0x1000, 0x1005, 0x1006, 0x1007, 0x1012, 0x1014, 0x1F80), (U32,)),
    **dict.fromkeys((0x1001, 0x100D, 0x1019), (U8,)),
    **dict.fromkeys((0x100C, 0x1015, 0x1017), (U16,)),
    **dict.fromkeys((0x1003, 0x1010, 0x1011, 0x1016, 0x1018), (U8, U32)),
    0x1029: (U8,),
    **dict.fromkeys(range(0x1200, 0x1280), (U8, U32, U32, U8, None)),
    **dict.fromkeys((*range(0x1400, 0x1600), *range(0x1800, 0x1A00)), PARAMETERS),
    **dict.fromkeys((*range(0x1600, 0x1800), *range(0x1A00, 0x1C00)), (U8, U32)),
}


def test_what_the_services_read_has_its_type():
    for index in range(0x1000, 0x2000):
        for subindex in (*range(10), 0x40, 0xFE):
            types = TYPES.get(index, (None,))
            found = required_type(index, subindex)
            wanted = types[min(subindex, len(types) - 1)]
            assert (found and found.name) == wanted, f"0x{index:04X}.{subindex:02X}"


def test_the_predefined_connection_set():
    """CiA 301, 7.3.5: the identifier, and how often the node-ID is added."""
    wanted = {(0x1005, 0): (0x80, 0), (0x1012, 0): (0x100, 0), (0x1014, 0): (0x80, 1)}
    wanted |= {(0x1200, 1): (0x600, 1), (0x1200, 2): (0x580, 1)}
    wanted |= {(index, sub): OFF for index in range(0x1201, 0x1280) for sub in (1, 2)}
    wanted |= {(index, 1): OFF for first in (0x1400, 0x1800) for index in range(first, first + 512)}
    for number in range(4):
        wanted[0x1400 + number, 1] = 0x200 + 0x100 * number, 1
        wanted[0x1800 + number, 1] = 0x180 + 0x100 * number, 1
    for index in range(0x1000, 0x2000):
        for subindex in range(4):
            found = predefined_default(index, subindex)
            assert found == wanted.get((index, subindex)), f"0x{index:04X}.{subindex:02X}"


@pytest.mark.parametrize(
    ("data_type", "largest"),
    # IEEE 754: (2 - 2^-23) 2^127; a double is a Python float.
    [(REAL32, (2.0 - 2.0**-23) * 2.0**127), (REAL64, sys.float_info.max)],
)
def test_a_real_reaches_as_far_down_as_up(data_type, largest):
    assert (data_type.low, data_type.high) == (-largest, largest)
