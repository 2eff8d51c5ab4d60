"""J1939 by its tables: groups, contents and transfers, entry by entry and limit by limit.

Numbers of groups are those of SAE J1939-71, -73 and -81 in decimal; times those of J1939-21.
"""

import random

import pytest

from hil_bench.abilities.eyes.j1939 import content_of, group_name, lamps_of, trouble_codes
from hil_bench.abilities.eyes.j1939_transfers import FastPackets, LongMessages

MS = 1_000_000
GROUPS = {
    0: "TSC1", 59392: "acknowledgement", 59904: "request", 60160: "TP.DT", 60416: "TP.CM",
    60928: "address claimed", 61184: "proprietary A", 65536 + 61184: "proprietary A2",
    61441: "EBC1", 61442: "ETC1", 61443: "EEC2", 61444: "EEC1", 61445: "ETC2", 64982: "BJM1",
    64983: "EJM1", 64984: "BJM2", 64985: "EJM2", 65226: "DM1", 65227: "DM2", 65228: "DM3",
    65240: "commanded address", 65242: "software identification", 65253: "engine hours",
    65259: "component identification", 65260: "vehicle identification", 65262: "ET1",
    65263: "EFL/P1", 65265: "CCVS", 65266: "LFE", 65269: "AMB", 65270: "IC1", 65271: "VEP1",
    65276: "DD",
    **{65040 + n: f"auxiliary valve {n} estimated flow" for n in range(16)},
    **{65056 + n: f"auxiliary valve {n} measured flow" for n in range(16)},
    **{65072 + n: f"auxiliary valve {n} command" for n in range(16)},
    **dict.fromkeys(range(65280, 65536), "proprietary B"),
    **dict.fromkeys(range(126976, 131072), "NMEA 2000"),
}  # fmt: skip


def test_each_group_has_its_name_and_no_other_has_one():
    found = {group: group_name(group) for group in range(1 << 17)}
    assert {group for group, name in found.items() if name} == set(GROUPS)
    assert all(found[group].startswith(name) for group, name in GROUPS.items())


ABOUT = "CA FE 00"  # PGN 65226, DM1


@pytest.mark.parametrize(
    ("group", "data", "words"),
    [
        (59904, "CA FE 00", "PGN 65226 DM1, active trouble codes"),
        (59904, "00 01 01", "PGN 65792"),
        (59904, "CA FE", ""),
        (59392, f"00 FF FF FF FF {ABOUT}", "done, PGN 65226 DM1, active trouble codes"),
        (59392, f"01 FF FF FF FF {ABOUT}", "refused, PGN 65226 DM1, active trouble codes"),
        (59392, f"02 FF FF FF FF {ABOUT}", "access denied, PGN 65226 DM1, active trouble codes"),
        (59392, f"03 FF FF FF FF {ABOUT}", "cannot respond, PGN 65226 DM1, active trouble codes"),
        (59392, f"04 FF FF FF FF {ABOUT}", ""),
        (60416, f"10 02 01 25 FF {ABOUT}", "RTS, 258 bytes in 37 packets, PGN 65226 DM1"),
        (60416, f"11 02 03 FF FF {ABOUT}", "CTS, 2 packets from 3, PGN 65226 DM1"),
        (60416, f"13 02 01 25 FF {ABOUT}", "end of message, 258 bytes, PGN 65226 DM1"),
        (60416, f"20 09 00 02 FF {ABOUT}", "BAM, 9 bytes in 2 packets, PGN 65226 DM1"),
        (60416, f"FF 03 FF FF FF {ABOUT}", "abort, reason 3, PGN 65226 DM1"),
        (60416, f"12 03 FF FF FF {ABOUT}", ""),
        (60416, "20 09 00 02 FF CA FE", ""),
        # The NAME by J1939-81: 21 bits identity, 11 bits manufacturer, function in bits 40 to 47.
        (60928, "FF FF 1F 00 00 00 00 00", "manufacturer 0, function 0, identity 2097151"),
        (60928, "00 00 E0 FF 00 00 00 00", "manufacturer 2047, function 0, identity 0"),
        (60928, "00 00 00 00 FF FF FF FF", "manufacturer 0, function 255, identity 0"),
        (60928, "00 00 00 00 00 00 00", ""),
        (65259, "41 2A 00", r"'A*\x00'"),
        (65260, "41 2A", "'A*'"),
        (65242, "01 41 2A", "'A*'"),
        (65072, "7D FF F0", "block 50 %"),
        (65087, "FA FF F3", "float 100 %"),
        (65072, "00 FF FE", "error 0 %"),
        (65072, "00 FF F4", "reserved 0 %"),
        (65072, "00 FF", ""),
        (65040, "7D 7D 31 1F C0", "extend, flow 0 %"),
        # A flow has 1 % a bit from -125 % on (ISO 11783-7).
        (65055, "FA 7D 32 1F C0", "retract, flow 125 %"),
        (65040, "7D 7D 3E 1F FF", "error, flow 0 %, obeys no command: reason 63"),
        (65040, "7D 7D 35 1F", ""),
        (65226, "00 00 00 00 00", ""),
        (65227, "55 FF 00 00 00 00", "lamp malfunction and stop and warning and protect"),
        (61441, "00", ""),
    ],
)
def test_a_content_has_these_words(group, data, words):
    found = content_of(group, bytes.fromhex(data))
    assert found.startswith(words)
    assert bool(found) is bool(words)


def test_lamps_have_two_bits_each_and_01_is_on():
    names = ("protect", "warning", "stop", "malfunction")
    for byte in range(256):
        on = [
            name for place, name in enumerate(names) if f"{byte:08b}"[6 - 2 * place :][:2] == "01"
        ]
        assert lamps_of(bytes([byte, 0])) == on[::-1]
    assert lamps_of(b"") == []


def test_trouble_codes_are_spn_and_fmi_of_version_4():
    """J1939-73: 8 bits, 8 bits and the upper 3 of the third byte are SPN, the lower 5 FMI."""
    dice = random.Random(1)  # noqa: S311 - no secrets
    for count in range(5):
        codes = [(dice.randrange(1, 1 << 19), dice.randrange(32)) for _ in range(count)]
        data = b"\x40\xff"
        for spn, fmi in codes:
            bits = f"{spn >> 16:03b}{fmi:05b}"
            data += bytes([spn & 255, spn >> 8 & 255, int(bits, 2), 0x80 | dice.randrange(128)])
        assert trouble_codes(data + bytes(dice.randrange(4))) == codes
        words = ", ".join(["lamp malfunction", *(f"SPN {s} FMI {f}" for s, f in codes)])
        assert not count or content_of(65226, data) == words
    assert trouble_codes(bytes(6)) == []
    assert content_of(65226, b"\x40\xff\0\0\0\0") == "lamp malfunction, no trouble code"


def announced(size, packets, control=32, to=255, group=65226):
    return bytes([control, size & 255, size >> 8, packets, 255, *group.to_bytes(3, "little")]), to


def begin(messages, data, to, source=3, now=0):
    return messages.take_control(0, (source, to), data, now)


@pytest.mark.parametrize(
    ("control", "to", "size", "packets", "problem"),
    [
        (32, 255, 9, 2, ""),
        (32, 255, 14, 2, ""),
        (32, 255, 15, 3, ""),
        (16, 7, 1785, 255, ""),
        (32, 255, 9, 1, "announced with 1 packets, 2 are right"),
        (16, 7, 15, 2, "announced with 2 packets, 3 are right"),
        (16, 7, 1786, 255, "announced with 1786 bytes, 1785 at most are right"),
        (32, 7, 9, 2, "BAM to one address"),
        (16, 255, 9, 2, "RTS to all"),
    ],
)
def test_an_announcement_is_right_or_says_what_would_be(control, to, size, packets, problem):
    messages = LongMessages()
    is_part, ended = begin(messages, *announced(size, packets, control, to))
    assert is_part is (not problem)
    assert [each.problem for each in ended] == [problem] * bool(problem)
    assert [each.culprit for each in ended] == [3] * bool(problem)
    assert len(messages.finish()) == (not problem)


@pytest.mark.parametrize(("size", "group"), [(8, 65226), (9, 1 << 18)])
def test_what_is_no_announcement_begins_nothing(size, group):
    messages = LongMessages()
    assert begin(messages, *announced(size, -(-size // 7), group=group)) == (False, [])
    assert messages.finish() == []


# T1 is 750 ms, a fifth is left to recorders; T3 is 1250 ms (SAE J1939-21).
@pytest.mark.parametrize(("control", "to", "patience"), [(32, 255, 900), (16, 7, 1250)])
def test_a_transfer_is_given_up_after_its_time(control, to, patience):
    messages = LongMessages()
    begin(messages, *announced(9, 2, control, to))
    assert messages.expire(patience * MS) == []
    (ended,) = messages.expire(patience * MS + 1)
    assert ended.culprit == (3 if to == 255 else 7)
    assert messages.expire(10**12) == []


@pytest.mark.parametrize(
    ("gap", "words"), [(9, ""), (8.9, "8.9 ms"), (220, ""), (221, "221 ms"), (50, "")]
)
def test_packets_to_all_have_a_pace(gap, words):
    messages, now = LongMessages(), 0
    begin(messages, *announced(21, 3))
    for number in range(1, 4):
        now += round(gap * MS)
        _, ended = messages.take_packet(0, (3, 255), bytes([number] * 8), now)
    (message,) = ended
    assert (message.problem, message.data) == ("", b"\1" * 7 + b"\2" * 7 + b"\3" * 7)
    right = f"{words} between its packets, 10 ms to 200 ms are right"
    assert message.pace == (right if words else "")
    assert message.gaps == [round(gap * MS)] * 3


def test_two_packets_have_no_pace_and_one_that_is_beyond_is_none():
    messages = LongMessages()
    begin(messages, *announced(14, 2))
    for number in (0, 3):
        assert messages.take_packet(0, (3, 255), bytes([number] * 8), 1) == (False, [])
    assert messages.take_packet(0, (3, 255), b"\1" * 7, 1) == (False, [])
    messages.take_packet(0, (3, 255), b"\1" * 8, 1)
    _, (message,) = messages.take_packet(0, (3, 255), b"\2" * 8, 2)
    assert (message.pace, message.problem) == ("", "")


def test_256_transfers_are_followed_and_of_more_the_oldest_is_let_go():
    messages = LongMessages()
    for number in range(256):
        assert (
            begin(messages, *announced(9, 2, 16, number % 128), source=200 + number // 128)[1] == []
        )
    _, (oldest,) = begin(messages, *announced(9, 2, 16, 1), source=210)
    assert (oldest.key, oldest.problem) == ((0, 200, 0), "not followed: too many at once")
    assert len(messages.finish()) == 256


def fast(frames):
    """Plain: after a first frame of a length, the next number of the same sequence within 50 ms."""
    found, state = [], None
    for data, now in frames:
        sequence, number = data[0] >> 5, data[0] & 31
        part = None
        if number == 0:
            length = data[1]
            count = 1 + (max(length - 6, 0) + 6) // 7
            state = (sequence, 0, count, now) if 9 <= length <= 223 else None
        else:
            if state and state[:2] == (sequence, number - 1) and now - state[3] <= 50 * MS:
                part = number + 1, state[2]
            is_on = part is not None and part[0] < part[1]
            state = (sequence, number, state[2], now) if is_on else None
        found.append(part)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_fast_packets_are_known_by_their_numbers_and_times(seed):
    dice = random.Random(seed)  # noqa: S311 - no secrets
    frames, now = [], 0
    for _ in range(300):
        sequence, length = dice.randrange(8), dice.choice((8, 9, 13, 14, 20, 21, 223, 224))
        for number in range(dice.choice((2, 3, 5, 32))):
            if dice.random() < 0.9:
                frames.append((bytes([sequence << 5 | number, length, *bytes(6)]), now))
            now += dice.choice((1, 1, 1, 50 * MS, 50 * MS + 1))
    packets = FastPackets()
    assert [packets.part_of((0, 3, 255), 0x1F801, *each) for each in frames] == fast(frames)


@pytest.mark.parametrize(
    ("group", "length", "is_one"),
    [(0x1ECFF, 8, False), (0x1ED00, 8, True), (0x1FFFF, 8, True), (0x20000, 8, False),
     (0x1F801, 7, False)],
)  # fmt: skip
def test_only_frames_of_eight_bytes_in_a_range_are_fast_packets(group, length, is_one):
    packets = FastPackets()
    packets.part_of((0, 3, 255), group, bytes([0, 9, *bytes(6)])[:length], 0)
    found = packets.part_of((0, 3, 255), group, bytes([1, *bytes(7)])[:length], 1)
    assert found == ((2, 2) if is_one else None)
