"""Frames that checks put on the bus: what their clauses ask for, on the device of the tests.

Its RPDO 0x1400 carries two numbers in four bytes, its TPDO 0x1800 is 0x185. Bit 31 of a COB-ID says
that a PDO does not exist, bit 30 that it may not be asked for (CiA 301, 7.5.2.35 and 7.5.2.37).
Reads (SDO uploads) are left out.
"""

import contextlib
import struct
from itertools import groupby

import pytest

from hil_bench.abilities.conformance.pdo import RPDOS, Entry, Pdo, first_pdo
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable

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
        with contextlib.suppress(NotApplicable):
            check.judge(laboratory.dut)
        reads = [each.can_id == 0x605 and each.data[0] == 0x40 for each in sent]
        lists.append(
            [words(each) for each, is_read in zip(sent, reads, strict=True) if not is_read]
        )
    return lists


def of_the_first(frames):
    """The frames of a check until it begins anew with the second PDO, 0x1401 or 0x1801."""
    ends = [place for place, each in enumerate(frames) if each[:7] in {"1401.01", "1801.01"}]
    if not ends:
        return frames
    return frames[: ends[0] - (frames[ends[0] - 1] == frames[0])]


def rpdo(kind, *frames, timer=""):
    """A check of an RPDO: it is configured while it is not valid, and restored likewise."""
    configured = ["1400.01=80000205", f"1400.02={kind}"]
    restored = ["1400.01=80000205", "1400.02=ff"]
    if timer:
        configured.append(f"1400.05={timer}")
        restored.append("1400.05=0000")
    restored += ["1400.01=80000205", "1400.01=00000205"]
    return [*configured, "1400.01=00000205", *frames, *restored]


UNREAD = "1401h: what it carries cannot all be read"
"""Its RPDO 0x1401 carries 24 bits and one bit."""

CHANGED, BEFORE = "205 01000100", "205 00000000"


def test_rpdos_are_sent_as_their_clauses_say(laboratory):
    end = [BEFORE, "SYNC", PREPARE]
    window = ["SYNC", CHANGED, "SYNC", BEFORE, "SYNC", CHANGED, "SYNC"]
    found = [of_the_first(check) for check in asked(laboratory, "RPDO")]
    assert found[:3] == [
        rpdo("ff", START, CHANGED, *end),
        rpdo("01", START, CHANGED, "SYNC", *end),
        ["1007.00=00004e20", *rpdo("01", START, *window, *end), "1007.00=00000000"],
    ]
    assert found[3][:4] == rpdo("ff")[:3] + found[3][3:4]
    sent = [each for each in found[3] if "." not in each]
    assert sent == [found[3][3], STOP, found[3][3], PREPARE]
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
    checks = asked(laboratory, "TPDO")
    found = [of_the_first(check) for check in checks]
    syncs = ["SYNC"] * 9
    counted = [f"SYNC {number:02x}" for number in range(1, 6)]
    remote = {"cob_id": "00000185"}
    timer, off = "1800.05=0032", "1800.05=0000"
    inhibit = {"more": ("1800.05=000a", "1800.03=01f4"), "undo": (off, "1800.03=0000")}
    others = [check[len(first) :] for check, first in zip(checks, found, strict=True)]
    # There are two more TPDOs; the values of one of them cannot all be read.
    assert [other.count("SYNC") for other in others[:4]] == [10, 18, 8, 1]
    assert found[:8] == [
        tpdo("01", START, *syncs[:5], PREPARE),
        tpdo("03", START, *syncs, PREPARE),
        tpdo("01", PREPARE, "SYNC", "SYNC", PREPARE, STOP, "SYNC", "SYNC", PREPARE),
        tpdo("01", START, "SYNC", PREPARE),
        [
            frame
            for kind in ("fe", "ff")
            for frame in tpdo(kind, START, PREPARE, more=(timer,), undo=(off,))
        ],
        tpdo("fe", START, PREPARE, **inhibit) + tpdo("ff", START, PREPARE, **inhibit),
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


# CiA 301, 7.2.4.3.9 to 7.2.4.3.14: A4 and A3 begin an upload, A2 confirms a block with the size of
# the next one, A1 ends it; C6 begins a download, D5 and D9 end it with 5 and 6 bytes unused.
def begun(size, threshold=0, index=0x1008):
    return f"605 a4{index.to_bytes(2, 'little').hex()}00{size:02x}{threshold:02x}0000"


GO, END = "605 a300000000000000", "605 a100000000000000"
TEXT = [number * 7 % 95 + 32 for number in range(100)]


def confirmed(*pairs):
    return [f"605 a2{count:02x}{size:02x}0000000000" for count, size in pairs]


def segments(data):
    """Return the segments of a block: numbered, of seven bytes, the last with bit 7."""
    parts = [bytes(data[start : start + 7]).ljust(7, b"\0") for start in range(0, len(data), 7)]
    last = len(parts)
    return [f"605 {n | (n == last) << 7:02x}{part.hex()}" for n, part in enumerate(parts, 1)]


def crc(data):
    """CRC-CCITT bit by bit, as its bytes are sent (7.2.4.3.16)."""
    found = 0
    for byte in data:
        found ^= byte << 8
        for _ in range(8):
            found = (found << 1 ^ 0x1021 * (found >> 15)) & 0xFFFF
    return found.to_bytes(2, "little").hex()


def test_blocks_are_transferred_as_their_clauses_say(laboratory):
    """The longest text, 0x1008, has two segments; 0x2020 takes a hundred bytes."""
    lists = asked(laboratory, "SDO block transfer")
    plain = ("605 60", "605 70", "605 80", begun(127, index=0x1000))  # reads, aborts, a first look
    found = [[each for each in check if not each.startswith(plain)] for check in lists]
    assert found[:6] == [
        [begun(127), GO, *confirmed((2, 127)), END],
        [begun(1), GO, *confirmed((1, 2), (1, 3)), END],
        [begun(127), GO, *confirmed((0, 127), (1, 127), (1, 127)), END],
        [begun(0), begun(128)],
        [begun(1), GO, *confirmed((127, 1))],
        [begun(127), GO],
    ]
    assert begun(127, 4, index=0x1000) in found[6]
    begin, end = "605 c620200064000000", f"605 d5{crc(TEXT)}0000000000"
    assert found[7][:17] == [begin, *segments(TEXT), end]
    lost = segments(TEXT)
    del lost[2]
    assert found[8][:29] == [begin, *lost, *segments(TEXT[14:]), end]
    # 0x1017 has two bytes: 0 as it was, or 7; the CRC of the first of these is wrong.
    small = "605 c617100002000000"
    seven, zero = "605 8107000000000000", "605 8100000000000000"
    assert found[9][:2] == [small, seven]
    assert found[9][2][:6] == "605 d5"
    assert found[9][2][6:10] != crc([7, 0])
    assert found[10][:3] == [small, zero, "605 d900000000000000"]
    assert found[11][:2] == [small, "605 0000000000000000"]
    assert found[12][:2] == [small, seven]
    # 0800 0000h, general error, of the object of the transfer.
    aborts = {each for check in lists for each in check if each.startswith("605 80")}
    objects = ("001000", "081000", "202000", "171000")
    assert aborts == {f"605 80{place}00000008" for place in objects}


def test_sync_and_time_are_asked_as_their_clauses_say(laboratory):
    """0x1005 has bit 30 where the device produces SYNC, every 0x1006 microseconds; 0x1019 counts
    it up to 240. 0x6D2 is another identifier that nobody has; TIME is 0x100."""
    on, off = "1005.00=40000080", "1005.00=00000080"
    period, none, second = (f"1006.00={each:08x}" for each in (20_000, 0, 1_000_000))
    counted, uncounted = ["1019.00=05"], ["1019.00=00"]
    moved = tpdo("01", START, *["6d2"] * 3, *["SYNC"] * 3, PREPARE)
    found = asked(laboratory, "SYNC and TIME")
    assert found[:8] == [
        [],
        ["1005.00=000006d2", *moved, off],
        ["1019.00=01", "1019.00=f1"],
        [period, "1019.00=0a", none],
        [on, off, *uncounted, period, on, off, none, *uncounted],
        [on, off, *counted, period, on, off, none, *uncounted],
        [on, off, second, on, "1005.00=400006d2", off, none],
        [f"1012.00={each}" for each in (
            "00000100", "000006d2", "800006d2", "800006d3", "000006d2", "00000100")],
    ]  # fmt: skip
    # Milliseconds since midnight in four bytes, days in two; then less of it, and a remote frame.
    lengths = [len(bytes.fromhex(each[4:])) for each in found[8][:3]]
    assert (lengths, found[8][3]) == ([6, 3, 0], "100 remote")


def test_downloads_are_sent_as_their_clauses_say(laboratory):
    """7.2.4.3.3: 2 expedited, 1 size given; bits 2 and 3 count unused bytes. 7.2.4.3.4: of a
    segment bits 1 to 3 count unused bytes, bit 4 toggles, bit 0 ends. 0x1017 has two bytes."""
    found = asked(laboratory, "SDO download")
    undo = ["605 8017100000000008", "1017.00=0000"]
    begin, value = "605 2117100002000000", "605 0bd2040000000000"  # 1234
    assert found[:5] == [
        ["1017.00=04d2", *undo],
        ["605 22171000d2040000", *undo],
        ["605 2717100000000000", "1017.00=00", *undo],
        [begin, value, *undo],
        ["605 2017100000000000", value, *undo],
    ]
    length = int.from_bytes(bytes.fromhex(found[5][0][12:]), "little")
    parts = [bytes.fromhex(each[4:]) for each in found[5][1 : 1 + -(-length // 7)]]
    commands = [each[0] for each in parts]
    last = (len(parts) - 1) % 2 << 4 | (-length % 7) << 1 | 1
    assert commands == [*(place % 2 << 4 for place in range(len(parts) - 1)), last]
    data = b"".join(each[1:] for each in parts)
    assert data[:length].decode().isprintable()
    assert not any(data[length:])
    assert found[6:9] == [
        ["605 2117100002000000", "605 1bd2040000000000", *undo],
        ["605 2117100002000000", "605 0900000000000000", *undo],
        [
            "605 2117100002000000", "605 0dd2000000000000", *undo,
            "605 2120200003000000", "605 0b61620000000000",
            "605 8020200000000008", "605 2720200061626300",
        ],
    ]  # fmt: skip
    assert found[9][:1] == ["605 2117100003000000"]
    assert found[10] == ["605 8017100000000008", "605 0b00000000000000"]
    assert found[11] == [begin, undo[0], value, *undo]


def test_nmt_is_commanded_as_its_clauses_say(laboratory):
    """7.2.8.3.1: 01 start, 02 stop, 80 pre-operational, 81 and 82 reset; 0 means all nodes. States
    are watched by a heartbeat of 50 ms."""
    found = asked(laboratory, "NMT")
    on, off, again = "1017.00=0032", "1017.00=0000", ["NMT 8205", PREPARE]
    assert found[:5] == [
        ["NMT 8105", PREPARE],
        again,
        [*again, on, START, PREPARE, off],
        ["NMT 8205", on, PREPARE, off],
        [on, START, STOP, START, PREPARE, STOP, PREPARE, PREPARE, off],
    ]
    others = [f"6{node_id:02x} 4000100000000000" for node_id in range(1, 128) if node_id != 5]
    assert found[5][:126] == others
    assert found[6:] == [
        [on, "NMT 027f", PREPARE, off],
        [on, "NMT 0305", "NMT 02", "NMT", "NMT remote", "NMT 29 bits 0205", PREPARE, off],
        [STOP, PREPARE],
        [START, PREPARE],
        [
            *again,
            "1005.00=000000c0",
            "1014.00=80000085",
            "1019.00=40",
            "1029.01=01",
            "1017.00=0040",
            "1015.00=0040",
            "100c.00=0040",
            "1016.01=00000040",
            "1400.01=80000205",
            "1800.01=c0000185",
            *again,
        ],
    ]


def test_emergencies_are_provoked_as_their_clauses_say(laboratory):
    """A heartbeat of node 0x7F that stays out, whose beats are one here: 0x1016.01 waits 500 ms."""
    sent = [[each for each in check if each[:1] != "6"] for check in asked(laboratory, "EMCY")]
    found = [[each for each, _ in groupby(check)] for check in sent]
    wait, none, beat = "1016.01=007f01f4", "1016.01=00000000", "77f 05"
    assert found[:2] == [[], ["1003.00=01"]]
    assert found[2] == [wait, beat, none]
    assert found[3] == [wait, beat, none]
    assert found[4] == ["NMT 8205", PREPARE, wait, beat, "1003.00=00", none]
    assert found[5:] == [
        ["1014.00=80000085", wait, beat, none, "1014.00=00000085"],
        ["1014.00=00000185"],
        ["1015.00=07d0", wait, beat, none, "1015.00=0000"],
    ]


MAPPINGS = (
    ("1400.01", "80000205", "00000205", "1600", ("20000010", "20010010")),
    ("1800.01", "c0000185", "40000185", "1a00", ("20100010", "20110010")),
)


def mapped(*entries, restored=True):
    """The writes to both mappings while their PDOs do not exist; entries by sub-index."""
    sent = []
    for place, off, on, mapping, own in MAPPINGS:
        sent += [f"{place}={off}", f"{mapping}.00=00"]
        sent += [f"{mapping}.{entry.format(own[0][:4])}" for entry in entries]
        if restored:
            sent.append(f"{mapping}.00=00")
        sent += [f"{mapping}.{n:02}={entry}" for n, entry in enumerate(own, 1)]
        sent += [f"{mapping}.00=02", f"{place}={off}", f"{place}={on}"]
    return sent


def test_mappings_are_written_as_their_clauses_say(laboratory):
    """7.5.2.36: index, sub-index and bits of an object; 0 entries first, and their number last.
    0xC0DE and 0x1018.FE are no objects, 0x1000 cannot be mapped, no object has 24 bits."""
    found = asked(laboratory, "PDO mapping")
    assert found[0] == mapped(restored=False)
    enabled, valid = [], []
    for place, off, on, mapping, own in MAPPINGS:
        without, there = f"{place}={off}", f"{place}={on}"
        other = f"{int(own[0], 16) ^ 0x100:08x}"
        enabled += [without, f"{mapping}.01={other}", without, there]
        valid += [without, there, f"{mapping}.00=00", without, without, there]
    assert found[1:3] == [enabled, valid]
    assert found[3] == mapped("01=c0de0008", "01=1018fe20")
    assert found[4] == mapped("01=10000020")
    assert found[5] == mapped("01={}0018")
    assert found[7] == mapped("00=41")
    place, off, on, mapping, own = MAPPINGS[0]
    dummy = [f"{place}={off}", "1600.00=00", "1600.01=00050008", f"1600.02={own[0]}", "1600.00=02"]
    restored = [f"{place}={off}", "1600.00=00", "1600.01=20000010", "1600.02=20010010"]
    got = ["NMT 0105", "205 ff0100", "SYNC", "2000.00=0000", PREPARE]
    end = ["1600.00=02", f"{place}={off}", f"{place}={on}"]
    assert found[8] == [*dummy, f"{place}={on}", *got, *restored, *end]


def test_the_longest_object_is_mapped_until_64_bits_are_exceeded(
    make_laboratory, eds_path, tmp_path
):
    """7.5.2.36: three objects of 32 bits are too long together, and their number is refused."""
    text = eds_path.read_text(encoding="utf-8").replace("0x20000010", "0x20000020")
    head, section, rest = text.partition("[2000]\n")
    path = tmp_path / "long.eds"
    path.write_text(head + section + rest.replace("0x0006", "0x0007", 1), encoding="utf-8")
    (place, off, on, mapping, (_, other)), _ = MAPPINGS
    long, none = "20000020", f"{mapping}.00=00"
    tried = [none, *(f"{mapping}.0{n}={long}" for n in (1, 2, 3)), f"{mapping}.00=03"]
    restored = [none, f"{mapping}.01={long}", f"{mapping}.02={other}", f"{mapping}.00=02"]
    found = asked(make_laboratory(path), "PDO mapping")[6]
    assert found == [f"{place}={off}", *tried, *restored, f"{place}={off}", f"{place}={on}"]


def test_parameters_are_stored_as_their_clauses_say(make_variant):
    """7.5.2.13: "save" to 0x1010 alone, "load" to 0x1011; a reset then shows what was stored. Bit 2
    of 0x1F80 keeps a node from starting by itself (CiA 302-2)."""
    save, load = (f"{place}={word[::-1].encode().hex()}" for place, word in (
        ("1010.01", "save"), ("1011.01", "load")))  # fmt: skip
    words_of = {"1010": "64616f6c", "1011": "65766173"}
    wrong = [f"{i}.{sub:02}={word}" for i, word in words_of.items() for sub in range(1, 5)]
    value, none = "1017.00=10e1", "1017.00=0000"
    starts, waits = "1f80.00=00000000", "1f80.00=00000004"
    watched = [PREPARE, save, "NMT 8105", "1017.00=0032", PREPARE, none]
    assert asked(make_variant(startup=4), "Store and restore") == [
        [],
        [],
        wrong,
        [value, PREPARE, save, "NMT 8105", PREPARE, none, PREPARE, save],
        [value, PREPARE, save, PREPARE, load, "NMT 8105", PREPARE],
        [starts, *watched, waits, *watched, PREPARE, waits, PREPARE, save],
    ]


def test_error_control_is_asked_as_its_clauses_say(laboratory):
    """Heartbeats of 100 ms and 10 s; guarding of 50 ms, three times; 0x1016 waits 100 and 500 ms
    for node 0x7F, which is not twice in it; each choice of 0x1029.01."""
    found = [[each for each, _ in groupby(e)] for e in asked(laboratory, "Error control")]
    none, reset, missed = "1017.00=0000", ["NMT 8205", PREPARE], "1016.01=007f01f4"
    assert found[1:6] == [
        ["1017.00=0064", none, "1017.00=012c", none],
        ["1017.00=0064", none],
        [*reset, "705 remote"],
        ["1017.00=2710", "705 remote", none],
        [*reset, "100c.00=0032", "100d.00=03", "705 remote", "100d.00=00", "100c.00=0000"],
    ]
    assert found[7:9] == [
        ["1016.01=007f0064", "1016.01=00000000"],
        [missed, "1016.02=007f012c", "1016.01=00000000"],
    ]
    assert found[9] == [
        each
        for choice in range(3)
        for each in (
            *(reset if not choice else ()), f"1029.01={choice:02x}", missed, "1017.00=0032", START,
            "77f 05", PREPARE, none, *reset,
        )
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("title", "details"),
    [
        # 0x1000 is 0x191, 0x1001 is 0; 0800 0024h is "no data" of 0x1003.01.
        ("Object dictionary", {0: "00000191h", 1: "00h", 9: "0 errors, 0800 0024h"}),
        ("SDO upload", {1: "0x1008.00, 11 bytes", 12: "20 of 20 answered"}),
        ("SDO download", {0: "0x1017.00", 1: "taken", 6: "0503 0000h", 9: "0607 0012h"}),
        ("SDO block transfer", {0: "0x1008.00, 11 bytes, with CRC", 4: "0504 0003h"}),
        (
            "TPDO",
            {
                0: "1800h 4 bytes; 1801h 4 bytes; 1802h 4 bytes",
                1: "1800h; 1801h; 1802h",
                3: "1800h 00 00 00 00; 1801h 00 00 00 00; "
                "1802h: what it carries cannot all be read",
                4: "; ".join(
                    f"{pdo}h type 254 50.0 ms, type 255 50.0 ms" for pdo in (1800, 1801, 1802)
                ),
                6: "; ".join(f"{pdo}h type 252, type 253" for pdo in (1800, 1801, 1802)),
                9: "4 TPDOs",
            },
        ),
        (
            "RPDO",
            {
                0: f"1400h 4 bytes; {UNREAD}",
                2: f"1400h discarded after the window; {UNREAD}",
                5: f"1400h EMCY 8220h; {UNREAD}",
            },
        ),
        ("PDO parameters", {0: "0609 0030h (1400h, 1800h)", 2: "0609 0030h (1800h)"}),
        (
            "PDO mapping",
            {
                0: "1600h, 1A00h",
                1: "0601 0000h (1400h, 1800h)",
                3: "1400h, 1800h",
                5: "0604 0041h (1400h, 1800h)",
                8: "1600h",
            },
        ),
        ("SYNC and TIME", {1: "by 1800h", 4: "20.0 ms", 6: "0609 0030h"}),
        ("EMCY", {2: "30 81 11 7F 00 00 00 00", 7: "200 ms"}),
        ("Store and restore", {0: "1h", 1: "1h"}),
        ("Error control", {1: "100.0 ms, 300.0 ms", 9: "3 choices"}),
    ],
)
def test_a_check_says_what_it_has_seen(laboratory, title, details):
    found = [each.detail for each in laboratory.run(title)]
    assert {place: found[place] for place in details} == details


@pytest.mark.parametrize(("count", "is_right"), [(0, False), (1, True), (4, True), (5, False)])
def test_an_identity_has_one_to_four_entries(laboratory, count, is_right):
    (chapter,) = [chapter for chapter in CHAPTERS if chapter.title == "Object dictionary"]
    (check,) = [each for each in chapter.checks if each.text == "1018h has the identity of the EDS"]
    laboratory.node.object_dictionary.variable(0x1018).value = count
    if is_right:
        assert check.judge(laboratory.dut) == "sub-index 2, 3"  # the vendor-ID is 0
    else:
        with pytest.raises(Deviation, match=f"0x1018.00 is {count}; 1 to 4 is right"):
            check.judge(laboratory.dut)


def test_the_structure_of_an_object_is_no_entry_of_it(make_laboratory, eds_path, tmp_path):
    """Sub-index FF describes the object (7.4.3.2): FE is the highest that it may have."""
    path = tmp_path / "most.eds"
    more = "\n[1018sub{}]\nParameterName=More\nObjectType=7\nDataType=7\nAccessType=ro\n"
    sections = more.format("FE") + more.format("FF")
    path.write_text(eds_path.read_text(encoding="utf-8") + sections, encoding="utf-8")
    laboratory = make_laboratory(path)
    laboratory.node.object_dictionary.variable(0x1018).value = 0xFE
    assert "highest_subindex" not in laboratory.failed_checks("Object dictionary")


def test_a_short_request_may_be_aborted(laboratory):
    laboratory.hears = lambda frame: (
        [frame._replace(data=b"\xe0" + bytes(7))]
        if frame.can_id == 0x605 and len(frame.data) < 8 and not frame.is_remote
        else [frame]
    )
    found = laboratory.run("SDO upload")
    assert {each.outcome for each in found} <= {Outcome.PASSED, Outcome.NOT_APPLICABLE}


def test_an_entry_of_a_mapping_is_index_subindex_and_bits(laboratory):
    """0x64110210 maps 0x6411.02 with 16 bits (7.5.2.36)."""
    laboratory.node.object_dictionary.variable(0x1600, 1).value = 0x64110210
    assert Pdo(laboratory.dut, 0x1400).entries[0] == Entry(0x6411, 2, 16)


def test_a_pdo_without_an_entry_is_not_looked_at(laboratory):
    with pytest.raises(NotApplicable):
        first_pdo(laboratory.dut, RPDOS, 9)
