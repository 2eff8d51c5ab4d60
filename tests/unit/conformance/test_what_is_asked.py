"""Frames that checks put on the bus: what their clauses ask for, on the device of the tests.

Its RPDO 0x1400 carries two numbers in four bytes, its TPDO 0x1800 is 0x185. Bit 31 of a COB-ID says
that a PDO does not exist, bit 30 that it may not be asked for (CiA 301, 7.5.2.35 and 7.5.2.37).
Reads (SDO uploads) are left out.
"""

import struct

import pytest

from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome

START, STOP, PREPARE = "NMT 0105", "NMT 0205", "NMT 8005"


def words(frame):
    """A frame in words; a download as object and value, the last byte first as people write it."""
    command, data = frame.data[:1].hex(), frame.data
    if frame.can_id == 0x605 and command in {"23", "2b", "2f"}:
        size = {"23": 4, "2b": 2, "2f": 1}[command]
        index, subindex = struct.unpack_from("<HB", data, 1)
        return f"{index:04x}.{subindex:02x}={data[4 : 4 + size][::-1].hex()}"
    name = {0x000: "NMT", 0x080: "SYNC", 0x7E5: "LSS"}.get(frame.can_id, f"{frame.can_id:x}")
    kind = "remote" * frame.is_remote + "29 bits " * frame.is_extended
    return f"{name} {kind}{data.hex()}".rstrip()


def asked(laboratory, title):
    """Return the frames of each check of a chapter, in its order."""
    (chapter,) = [chapter for chapter in CHAPTERS if chapter.title == title]
    lists = []
    for check in chapter.checks:
        sent = []
        laboratory.hears = lambda frame, sent=sent: [sent.append(frame) or frame][-1:]
        check.judge(laboratory.dut)
        reads = [each.can_id == 0x605 and each.data[0] == 0x40 for each in sent]
        lists.append(
            [words(each) for each, is_read in zip(sent, reads, strict=True) if not is_read]
        )
    return lists


def rpdo(kind, *frames, timer=""):
    """A check of an RPDO: it is configured while it is not valid, and restored likewise."""
    configured = ["1400.01=80000205", f"1400.02={kind}"]
    restored = ["1400.01=80000205", "1400.02=ff"]
    if timer:
        configured.append(f"1400.05={timer}")
        restored.append("1400.05=0000")
    restored += ["1400.01=80000205", "1400.01=00000205"]
    return [*configured, "1400.01=00000205", *frames, *restored]


CHANGED, BEFORE = "205 01000100", "205 00000000"


def test_rpdos_are_sent_as_their_clauses_say(laboratory):
    end = [BEFORE, "SYNC", PREPARE]
    window = ["SYNC", CHANGED, "SYNC", BEFORE, "SYNC", CHANGED, "SYNC"]
    found = asked(laboratory, "RPDO")
    assert found[:3] == [
        rpdo("ff", START, CHANGED, *end),
        rpdo("01", START, CHANGED, "SYNC", *end),
        ["1007.00=00004e20", *rpdo("01", START, *window, *end), "1007.00=00000000"],
    ]
    assert found[3][:4] == rpdo("ff")[:3] + found[3][3:4]
    assert not [each for each in found[3] if each.startswith(("NMT", "SYNC"))]
    sent = [[each for each in check if each.startswith("205")] for check in found[4:]]
    assert [len(each.partition(" ")[2]) // 2 for check in sent[:2] for each in check] == [
        3,
        4,
        5,
        4,
    ]
    for check in found[6:8]:
        assert check[:4] == rpdo("ff", timer="01f4")[:4]
        assert check[-5:] == rpdo("ff", timer="01f4")[-5:]
    assert sent[4][0] == "205 remote"
    assert sent[4][1].startswith("205 29 bits ")


def tpdo(kind, *frames, cob_id="40000185", more=(), undo=()):
    off = "1800.01=c0000185"
    configured = [off, *more, f"1800.02={kind}", f"1800.01={cob_id}"]
    return [*configured, *frames, off, *undo, "1800.02=ff", off, "1800.01=40000185"]


def test_tpdos_are_asked_for_as_their_clauses_say(laboratory):
    found = asked(laboratory, "TPDO")
    syncs = ["SYNC"] * 9
    counted = [f"SYNC {number:02x}" for number in range(1, 6)]
    remote = {"cob_id": "00000185"}
    timer, off = "1800.05=0032", "1800.05=0000"
    inhibit = {"more": ("1800.05=000a", "1800.03=01f4"), "undo": (off, "1800.03=0000")}
    assert found[:8] == [
        tpdo("01", START, *syncs[:5], PREPARE),
        tpdo("03", START, *syncs, PREPARE),
        tpdo("01", PREPARE, "SYNC", "SYNC", PREPARE, STOP, "SYNC", "SYNC", PREPARE),
        tpdo("01", START, "SYNC", PREPARE),
        tpdo("fe", START, PREPARE, more=(timer,), undo=(off,)),
        tpdo("fe", START, PREPARE, **inhibit),
        tpdo("fc", START, "SYNC", "185 remote", PREPARE, **remote)
        + tpdo("fd", START, "SYNC", "185 remote", PREPARE, **remote),
        [
            "1019.00=0a",
            "1800.01=c0000185", "1800.02=01", "1800.06=03", "1800.01=40000185",
            START, *counted, PREPARE,
            "1800.01=c0000185", "1800.02=ff", "1800.06=00", "1800.01=c0000185", "1800.01=40000185",
            "1019.00=00",
        ],
    ]  # fmt: skip


def test_pdo_parameters_are_written_that_are_refused(laboratory):
    """7.3.5: NMT, 001 to 07F, 101 to 180, SDO 581 to 5FF and 601 to 67F, 6E0 to 6FF, 701 to 7FF."""
    valid, restricted, inhibit = asked(laboratory, "PDO parameters")
    pdos = {"1400.01": ("80000205", "00000205"), "1800.01": ("c0000185", "40000185")}
    others = {"1400.01": "00000605", "1800.01": "40000585"}
    expected = [[], []]
    for place, (off, on) in pdos.items():
        bits = int(on, 16) & ~0x7FF
        expected[0] += [off, on, others[place], off, off, on]
        taken = (0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x7FF)
        expected[1] += [off, *(f"{bits | can_id:08x}" for can_id in taken), off, on]
    assert [each.partition("=")[2] for each in valid] == expected[0]
    assert [each.partition("=")[2] for each in restricted] == expected[1]
    off, on = (f"1800.01={each}" for each in pdos["1800.01"])
    assert inhibit == [off, on, "1800.03=0001", off, off, on]


def lss(service, number=0, *rest):
    return "LSS " + struct.pack("<BIBBB", service, number, *(rest or (0, 0, 0))).hex()


# CiA 305: 04 state WAITING, 40 to 43 select, 5A to 5E inquire, 11 node-ID, 13 bit timing, 46 to 4B
# identify, 51 fastscan, 4C identify non-configured; vendor 0, product 1, revision 1.0.
SERIAL = 0x12345678


def numbers(service, serial):
    own = [lss(service, 0), lss(service + 1, 1), lss(service + 2, 0x10000)]
    if service == 0x46:
        return [*own, lss(0x49, 0x10000), lss(0x4A, serial), lss(0x4B, serial)]
    return [*own, lss(0x43, serial)]


def test_lss_is_asked_as_cia_305_says(laboratory):
    wait, select = lss(4), numbers(0x40, SERIAL)
    there = [wait, *select, wait]
    nobody = SERIAL ^ 0x55AA0000
    found = asked(laboratory, "LSS")
    assert found == [
        there,
        [*there, *select, wait],
        [*there, *numbers(0x40, nobody)],
        [*there, *select, *map(lss, range(0x5A, 0x5F)), wait],
        [*there, *select, *(lss(0x11, node_id) for node_id in (0, 128, 5)), wait],
        [*there, *select, lss(0x13, 0x0500), wait],
        [*there, *numbers(0x46, SERIAL), *numbers(0x46, nobody)],
        [*there, lss(0x51, 0, 0x80, 0, 0), lss(0x4C)],
        [*there, wait, lss(0x5E)],
    ]


@pytest.mark.parametrize("title", ["RPDO", "TPDO", "PDO parameters", "LSS"])
def test_the_device_is_sound_in_these(laboratory, title):
    chapters = [chapter for chapter in CHAPTERS if chapter.title == title]
    assert {each.outcome for each in laboratory.run(chapters=chapters)} == {Outcome.PASSED}
