"""Frames in words; identifiers and codes are those of CiA 301."""

import pytest

from hil_bench.abilities.common.identifiers import Function, function_of
from hil_bench.abilities.eyes.frame_words import meaning_of


def test_an_identifier_tells_its_function():
    expected = {
        0x000: Function("NMT", None),
        0x080: Function("SYNC", None),
        0x081: Function("EMCY", 1),
        0x0FF: Function("EMCY", 127),
        0x100: Function("TIME", None),
        0x181: Function("TPDO1", 1),
        0x27F: Function("RPDO1", 127),
        0x501: Function("RPDO4", 1),
        0x585: Function("SDO answer", 5),
        0x605: Function("SDO request", 5),
        0x701: Function("heartbeat", 1),
        0x700: Function("other", None),
        0x7E4: Function("LSS answer", None),
        0x7E5: Function("LSS request", None),
        0x7FF: Function("other", None),
    }
    assert {can_id: function_of(can_id) for can_id in expected} == expected


@pytest.mark.parametrize(
    ("can_id", "data", "words"),
    [
        (0x000, "0100", "start, all nodes"),
        (0x000, "8105", "reset node, node 5"),
        (0x000, "0900", "command 9, all nodes"),
        (0x701, "00", "boot-up"),
        (0x701, "05", "OPERATIONAL"),
        (0x701, "85", "OPERATIONAL"),
        (0x701, "11", "state 17"),
        (0x081, "3081110000000000", "0x8130, life guard or heartbeat error"),
        (0x081, "0000000000000000", "0x0000, error reset"),
        (0x605, "4018100200000000", "upload 0x1018.02"),
        (0x585, "4318100234120000", "upload 0x1018.02"),
        (0x605, "2B17100064000000", "download 0x1017.00"),
        (0x585, "6017100000000000", "download 0x1017.00 done"),
        (0x585, "8017100002000106", "abort 0x1017.00, 0x06010002, attempt to write a read only"),
        (0x605, "6000000000000000", "segment or block"),
        (0x181, "0102", ""),
        (0x605, "40", ""),
    ],
)
def test_a_frame_is_told_in_words(can_id, data, words):
    assert meaning_of(can_id, bytes.fromhex(data)).startswith(words)
    assert bool(meaning_of(can_id, bytes.fromhex(data))) is bool(words)
