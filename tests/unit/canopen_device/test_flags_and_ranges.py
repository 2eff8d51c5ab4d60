"""Flags of answers, ranges of PDO objects, SYNC without 0x1005, one limit alone (CiA 301)."""

import math

import pytest

from hil_bench.canopen_device.datatypes import DATA_TYPES
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, Direction

UPLOAD = bytes.fromhex("4000100000000000")  # of 0x1000
REAL32 = 0x0008
START = Frame(0x000, b"\x01\x05")


def test_an_answer_is_a_data_frame_with_a_base_identifier(rig):
    rig.receive(0x605, UPLOAD)
    assert [(f.can_id, f.is_remote, f.is_extended, f.bus) for f in rig.run()] == [
        (0x585, False, False, 0)
    ]


@pytest.mark.parametrize("direction", list(Direction))
def test_there_are_512_pdos_each_way(direction):
    # CiA 301: 0x1400 to 0x15FF, 0x1800 to 0x19FF; the mapping of each is 0x200 above.
    indices = COMMUNICATION_INDICES[direction]
    assert len(indices) == 512
    assert indices[-1] + 1 == indices[0] + 0x200


def test_a_device_without_0x1005_hears_sync_at_0x080(object_dictionary):
    kept = [variable for variable in object_dictionary if variable.index != 0x1005]
    node = Node(ObjectDictionary(kept), 5)
    node.start(0)
    node.serve(0, [].append)
    node.receive(START, 0)
    for can_id in (0x080, 0x080, 0x080, 0x081):
        node.receive(Frame(can_id), 0)
    assert node.syncs == 3


@pytest.mark.parametrize(
    ("low", "high", "value", "code"),
    [
        (1.0, None, 0.5, 0x06090032),
        (1.0, None, 1.0, None),
        (None, 1.0, 1.5, 0x06090031),
        (None, 1.0, 1.0, None),
        (1.0, None, math.nan, 0x06090030),
        (None, 1.0, math.nan, 0x06090030),
        (None, None, math.nan, None),
    ],
)
def test_one_limit_alone_counts(low, high, value, code):
    variable = Variable(0x2000, 0, "Value", DATA_TYPES[REAL32], low=low, high=high)
    try:
        variable.check_limits(value)
        found = None
    except SdoAbort as error:
        found = error.code
    assert found == code
