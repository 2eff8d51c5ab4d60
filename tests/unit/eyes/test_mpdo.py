"""Multiplexed PDOs: the mapping says 0xFE or 0xFF, and each frame names its object.

Bytes as Lely's `co_mpdo_dn` and the MPDO handlers of emotas' and an Erlang stack read them.
"""

import pytest
from support.sdo_frames import download, heard

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.canopen_device.frame import Frame

HEARTBEAT = Frame(0x702, b"\x05")


def mapped(count):
    """Node 2 has its TPDO1 mapped by a master, event-driven."""
    enable = (0x4000_0182).to_bytes(4, "little")
    return [
        *download(2, 0x1800, 1, enable),
        *download(2, 0x1800, 2, b"\xfe"),
        *download(2, 0x1A00, 0, bytes([count])),
        HEARTBEAT,
    ]


@pytest.mark.parametrize(
    ("count", "data", "words"),
    [
        (0xFF, "85 0062 01 01020304", "MPDO to node 5: 0x6200.01 := [01 02 03 04]"),
        (0xFF, "80 0062 01 01000000", "MPDO to all: 0x6200.01 := [01 00 00 00]"),
        (0xFE, "02 3061 01 00000000", "MPDO from node 2: 0x6130.01 = [00 00 00 00]"),
    ],
)
def test_a_frame_is_read_by_the_object_that_it_names(count, data, words):
    decoder = Decoder()
    frames = [*mapped(count), Frame(0x182, bytes.fromhex(data))]
    sights = [sight for logged in heard(*frames) for sight in decoder.take(logged)]
    assert (sights[-1].words, sights[-1].problem) == (words, "")


def test_its_eight_bytes_are_right_and_seven_are_not():
    data = bytes.fromhex("85 0062 01 01020304")
    assert explain(heard(*mapped(0xFF), Frame(0x182, data)), [], 1_000_000).findings == ()
    (found,) = explain(heard(*mapped(0xFF), Frame(0x182, data[:7])), [], 1_000_000).findings
    assert "7 bytes, and its mapping has 8" in found.text
