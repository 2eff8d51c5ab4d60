"""Objects of a master in words; the parts of the concise DCF (CiA 302-3) are written by hand."""

import pytest
from support.sdo_frames import answer, download, heard, place, request

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.canopen_device.frame import Frame
from hil_drivers.concise_dcf import ConciseEntry, pack_concise_dcf

# Four entries, little-endian: 0x1017.00 of 2 bytes, 0x1800.02 of 1, 0x1800.05 of 2, 0x1A00.01 of 4.
DCF = bytes.fromhex(
    "04000000 1710 00 02000000 6400 0018 02 01000000 FE 0018 05 02000000 1400"
    "001A 01 04000000 08000110"
)
FIRST = "0x1017.00 := 0x0064, 0x1800.02 := 0xFE, 0x1800.05 := 0x0014"


def words_of(*frames):
    """The words and problems of the transfers of some frames."""
    decoder = Decoder()
    sights = [sight for logged in heard(*frames) for sight in decoder.take(logged)]
    return [(sight.words.rpartition(", ")[0], sight.problem) for sight in sights]


def written(index, subindex, data):
    """A segmented download to node 127 (CiA 301, 7.2.4.3.4)."""
    size = len(data).to_bytes(4, "little").hex()
    name = place(index, subindex).hex()
    frames = [request(127, f"21 {name} {size}"), answer(127, f"60 {name}")]
    parts = [data[k : k + 7] for k in range(0, len(data), 7)]
    for number, part in enumerate(parts):
        command = (number & 1) << 4 | (7 - len(part)) << 1 | (number == len(parts) - 1)
        frames.append(Frame(0x67F, bytes([command]) + part.ljust(7, b"\0")))
        frames.append(Frame(0x5FF, bytes([0x20 | (number & 1) << 4]) + bytes(7)))
    return frames


def test_a_concise_dcf_is_read():
    ((words, problem),) = words_of(*written(0x1F22, 5, DCF))
    assert words == f"download 0x1F22.05 Concise DCF := 4 entries: {FIRST}, and 1 more"
    assert problem == ""


def test_our_own_master_writes_what_is_read_here():
    """The other side of this repository, which packs it, agrees."""
    entries = [ConciseEntry(0x1F53, 1, bytes(9)), ConciseEntry(0x1017, 0, b"")]
    ((words, problem),) = words_of(*written(0x1F22, 5, pack_concise_dcf(entries)))
    assert words.endswith(":= 2 entries: 0x1F53.01 := 9 bytes, 0x1017.00 := nothing")
    assert problem == ""


@pytest.mark.parametrize(
    ("data", "text", "problem"),
    [
        (DCF[:-3], f"3 entries: {FIRST} ...", "ends within entry 4 of 4"),
        (DCF[:15], "1 entry: 0x1017.00 := 0x0064 ...", "ends within entry 2 of 4"),
        (
            DCF + b"\0",
            f"4 entries: {FIRST}, and 1 more ...",
            "1 byte too many behind its 4 entries",
        ),
        (b"\0\0\0\0", "0 entries", ""),
        (b"\1\0", "0 entries ...", "is no concise DCF, which begins with 4 bytes"),
        (
            b"\xff" * 4 + b"\0" * 9,
            "1 entry: 0x0000.00 := nothing ...",
            "ends within entry 2 of 4294967295",
        ),
    ],
)
def test_a_concise_dcf_that_is_not_whole_is_said(data, text, problem):
    assert words_of(*written(0x1F22, 5, data)) == [
        (f"download 0x1F22.05 Concise DCF := {text}", problem)
    ]


@pytest.mark.parametrize(
    ("index", "subindex", "value", "text"),
    [
        (
            0x1F80,
            0,
            "06000000",
            "NMT startup := 0x00000006, starts all at once, does not start by itself",
        ),
        (0x1F80, 0, "01000000", "NMT startup := 0x00000001, is the NMT master, starts by itself"),
        (
            0x1F81,
            5,
            "0103C800",
            "NMT slave assignment := 0x00C80301, in the network, guarded every 200 ms, 3 times",
        ),
        (0x1F81, 5, "0C000000", "NMT slave assignment := 0x0000000C, booted, mandatory"),
        (0x1F81, 0, "7F", "NMT slave assignment := 127"),
        (0x1F82, 5, "05", "Request NMT := start"),
        (0x1F82, 5, "81", "Request NMT := 129"),
        (0x1F84, 5, "98010000", "Expected device type := 0x00000198"),
        (0x1F89, 0, "88130000", "Boot time := 5000 ms"),
        (0x1F25, 5, "636F6E66", 'Configuration request := "conf"'),
        (0x1F26, 5, "64000000", "Expected configuration date := 100 days since 1984-01-01"),
    ],
)
def test_a_manager_is_read_in_words(index, subindex, value, text):
    frames = download(127, index, subindex, bytes.fromhex(value))
    assert words_of(*frames) == [(f"download 0x{index:04X}.{subindex:02X} {text}", "")]


# Multiplexed PDOs: the mapping says 0xFE or 0xFF, and each frame names its object.
#
# Bytes as Lely's `co_mpdo_dn` and the MPDO handlers of emotas' and an Erlang stack read them.


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
