"""The transport protocol of SAE J1939-21.

The bytes follow from the layout of TP.CM in 5.10.3: control byte, size (2), packets, packets at
once or 0xFF, PGN (3). The message is a component identification (PGN 65259) of 23 bytes, which
takes 4 packets.
"""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.j1939_bus import MILLISECOND, J1939Bus, collect, make_ecu

from hil_bench.abilities.j1939.protocol.reception import MOST_SESSIONS
from hil_bench.abilities.j1939.protocol.transmission import MOST_WAITING, AbortReason

COMPONENT = 0xFEEB
MESSAGE = b"MAKE*MODEL*SERIAL*UNIT*"
PACKETS = (
    "01 4d 41 4b 45 2a 4d 4f",
    "02 44 45 4c 2a 53 45 52",
    "03 49 41 4c 2a 55 4e 49",
    "04 54 2a ff ff ff ff ff",
)
RTS = "10 17 00 04 ff eb fe 00"
END = "13 17 00 04 ff eb fe 00"
BAM = "20 17 00 04 ff eb fe 00"
CM_TO, CM_FROM = 0x1CEC6410, 0x1CEC1064  # the partner is 0x10, the ECU 0x64
DT_TO, DT_FROM = 0x1CEB6410, 0x1CEB1064


def abort(reason, group="eb fe 00"):
    return CM_FROM, f"ff {reason:02x} ff ff ff {group}"


@pytest.fixture
def ecu():
    return make_ecu(100)


@pytest.fixture
def bus(ecu):
    return J1939Bus(ecu)


@pytest.fixture
def taken(ecu):
    return collect(ecu, [COMPONENT])


def test_a_message_comes_in_packets_and_is_acknowledged(bus, taken):
    assert bus.say(CM_TO, RTS) == [(CM_FROM, "11 04 01 ff ff eb fe 00")]
    for packet in PACKETS[:3]:
        assert bus.say(DT_TO, packet) == []
    assert bus.say(DT_TO, PACKETS[3]) == [(CM_FROM, END)]

    assert taken == [(COMPONENT, 0x10, MESSAGE)]


def test_the_sender_says_how_many_packets_it_sends_at_once(bus, taken):
    assert bus.say(CM_TO, RTS.replace("04 ff", "04 02")) == [(CM_FROM, "11 02 01 ff ff eb fe 00")]
    bus.say(DT_TO, PACKETS[0])
    assert bus.say(DT_TO, PACKETS[1]) == [(CM_FROM, "11 02 03 ff ff eb fe 00")]
    bus.say(DT_TO, PACKETS[2])
    assert bus.say(DT_TO, PACKETS[3]) == [(CM_FROM, END)]

    assert taken[0][2] == MESSAGE


def test_a_message_to_all_comes_without_acknowledgement(bus, taken):
    assert bus.say(0x1CECFF10, BAM) == []
    for packet in PACKETS:
        assert bus.say(0x1CEBFF10, packet) == []

    assert taken == [(COMPONENT, 0x10, MESSAGE)]


def test_a_message_goes_out_as_the_receiver_asks(bus, ecu):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    bus.run(1)
    assert bus.log[-1] == (1, CM_FROM, "10 17 00 04 04 eb fe 00")

    assert bus.say(CM_TO, "11 02 01 ff ff eb fe 00") == [(DT_FROM, each) for each in PACKETS[:2]]
    assert bus.say(CM_TO, "11 00 ff ff ff eb fe 00") == []  # wait
    assert bus.say(CM_TO, "11 02 03 ff ff eb fe 00") == [(DT_FROM, each) for each in PACKETS[2:]]
    assert bus.say(CM_TO, END) == []
    sent = len(bus.log)
    bus.run(3000)

    assert len(bus.log) == sent  # the session is over


def test_a_message_to_all_goes_out_with_50_ms_between_packets(bus, ecu):
    ecu.send(COMPONENT, MESSAGE)
    bus.run(300)

    assert bus.sent(0xEC00) == [(1, BAM)]
    # 0xFF in byte 5 is reserved in a BAM; the first packet follows 50 ms after it.
    assert bus.sent(0xEB00) == list(zip((50, 100, 150, 200), PACKETS, strict=True))


def test_a_lost_packet_is_asked_for_again(bus, taken):
    bus.say(CM_TO, RTS)
    bus.say(DT_TO, PACKETS[0])
    bus.say(DT_TO, PACKETS[2])

    assert bus.say(DT_TO, PACKETS[3]) == [(CM_FROM, "11 03 02 ff ff eb fe 00")]
    for packet in PACKETS[1:]:
        bus.say(DT_TO, packet)

    assert taken[0][2] == MESSAGE


def test_a_packet_is_asked_for_again_twice_at_most(bus):
    bus.say(CM_TO, RTS)
    for _ in range(2):
        assert bus.say(DT_TO, PACKETS[3])[0][1].startswith("11 04 01")

    assert bus.say(DT_TO, PACKETS[3]) == [abort(AbortReason.RETRANSMISSIONS)]


@pytest.mark.parametrize(
    ("packets", "reason"),
    [
        (["00 00 00 00 00 00 00 00"], AbortReason.BAD_SEQUENCE),
        (["05 00 00 00 00 00 00 00"], AbortReason.BAD_SEQUENCE),
        ([PACKETS[0], PACKETS[0]], AbortReason.DUPLICATE),
    ],
)
def test_a_wrong_sequence_number_ends_the_session(bus, packets, reason):
    bus.say(CM_TO, RTS)
    for packet in packets[:-1]:
        bus.say(DT_TO, packet)

    assert bus.say(DT_TO, packets[-1]) == [abort(reason)]
    assert bus.say(DT_TO, PACKETS[1]) == []


def test_a_packet_that_was_not_asked_for_ends_the_session(bus):
    bus.say(CM_TO, RTS.replace("04 ff", "04 02"))

    assert bus.say(DT_TO, PACKETS[2]) == [abort(AbortReason.UNEXPECTED_DATA)]


@pytest.mark.parametrize(
    ("announced", "reason"),
    [
        ("10 fa 06 ff ff eb fe 00", AbortReason.TOO_LONG),  # 1786 bytes
        ("10 08 00 02 ff eb fe 00", AbortReason.OTHER),  # 8 bytes need no transport
        ("10 17 00 03 ff eb fe 00", AbortReason.OTHER),  # 23 bytes are 4 packets
        ("10 17 00 04 00 eb fe 00", AbortReason.OTHER),  # none at once
    ],
)
def test_an_announcement_that_cannot_be_is_refused(bus, announced, reason):
    assert bus.say(CM_TO, announced) == [abort(reason)]


def test_the_longest_message_is_taken(bus, ecu):
    taken = collect(ecu, [0xEF00])
    bus.say(CM_TO, "10 f9 06 ff ff 00 ef 00")
    for number in range(1, 256):
        bus.say(DT_TO, f"{number:02x}" + " 55" * 7)

    assert taken == [(0xEF00, 0x10, b"\x55" * 1785)]


def test_a_second_session_of_one_partner_is_refused_and_the_first_goes_on(bus, taken):
    bus.say(CM_TO, RTS)

    other = RTS.replace("eb fe", "da fe")
    assert bus.say(CM_TO, other) == [abort(AbortReason.BUSY, "da fe 00")]
    for packet in PACKETS:
        bus.say(DT_TO, packet)

    assert taken[0][2] == MESSAGE


def test_the_same_announcement_again_begins_anew(bus, taken):
    bus.say(CM_TO, RTS)
    bus.say(DT_TO, PACKETS[0])

    assert bus.say(CM_TO, RTS) == [(CM_FROM, "11 04 01 ff ff eb fe 00")]
    for packet in PACKETS:
        bus.say(DT_TO, packet)

    assert taken[0][2] == MESSAGE


def test_sessions_are_bounded(bus, taken):
    for source in range(MOST_SESSIONS):
        assert bus.say(0x1CEC6400 | source, RTS)[0][1].startswith("11")
    (answer,) = bus.say(0x1CEC6450, RTS)

    assert answer == (0x1CEC5064, abort(AbortReason.RESOURCES)[1])
    for source in range(200):
        bus.say(0x1CECFF00 | source, BAM)
    for source in (0, MOST_SESSIONS - 1, MOST_SESSIONS, 199):
        for packet in PACKETS:
            bus.say(0x1CEBFF00 | source, packet)
    assert [source for _, source, _ in taken] == [0, MOST_SESSIONS - 1]


@pytest.mark.parametrize(("packets", "after"), [(0, 1250), (1, 750)])
def test_a_receiver_waits_1250_ms_for_the_first_packet_and_750_ms_for_the_next(bus, packets, after):
    bus.say(CM_TO, RTS)
    for packet in PACKETS[:packets]:
        bus.say(DT_TO, packet)

    bus.run(after - 1)
    assert bus.log[-1][2].startswith("11")
    bus.run(1)
    assert bus.log[-1][1:] == abort(AbortReason.TIMEOUT)


def test_a_gap_before_silence_is_asked_for_after_750_ms(bus):
    bus.say(CM_TO, RTS)
    bus.say(DT_TO, PACKETS[1])

    bus.run(750)

    assert bus.log[-1] == (750, CM_FROM, "11 04 01 ff ff eb fe 00")


def test_a_message_to_all_that_stops_is_dropped_in_silence(bus, taken):
    bus.say(0x1CECFF10, BAM)
    bus.say(0x1CEBFF10, PACKETS[0])

    bus.run(750)
    for packet in PACKETS[1:]:
        bus.say(0x1CEBFF10, packet)

    assert bus.sent(0xEC00) == []
    assert taken == []


@pytest.mark.parametrize(("told", "after"), [(None, 1250), ("11 00 ff ff ff eb fe 00", 1050)])
def test_a_sender_waits_1250_ms_and_after_a_cts_that_says_wait_1050_ms(bus, ecu, told, after):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    if told:
        bus.say(CM_TO, told)

    bus.run(after - 1)
    assert bus.log[-1][2].startswith("10")
    bus.run(1)
    assert bus.log[-1][1:] == abort(AbortReason.TIMEOUT)


def test_a_storm_of_cts_is_answered_three_times(bus, ecu):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    storm = "11 04 01 ff ff eb fe 00"

    answers = [bus.say(CM_TO, storm) for _ in range(100)]

    assert [len(answer) for answer in answers[1:5]] == [4, 4, 1, 0]
    assert answers[3] == [abort(AbortReason.RETRANSMISSIONS)]
    assert sum(map(len, answers)) == 1 + 3 * 4 + 1  # RTS, packets three times, abort


@pytest.mark.parametrize("first", [0, 3, 5])
def test_a_cts_for_a_packet_out_of_turn_ends_the_session(bus, ecu, first):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    bus.run(1)

    answer = bus.say(CM_TO, f"11 01 {first:02x} ff ff eb fe 00")

    assert answer == [abort(AbortReason.BAD_SEQUENCE)]


def test_an_early_end_of_message_is_not_believed(bus, ecu):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    bus.run(1)

    assert bus.say(CM_TO, END) == [abort(AbortReason.OTHER)]


def test_an_abort_ends_both_directions_in_silence(bus, ecu):
    ecu.send(COMPONENT, MESSAGE, 0x10)
    bus.say(CM_TO, RTS)

    assert bus.say(CM_TO, abort(AbortReason.RESOURCES)[1]) == []
    bus.run(3000)

    assert bus.log[-1][0] == 0


def test_messages_to_one_device_wait_for_each_other_up_to_a_bound(bus, ecu):
    taken = [ecu.send(COMPONENT, MESSAGE, 0x10) for _ in range(MOST_WAITING + 3)]

    assert taken == [True] * (MOST_WAITING + 1) + [False] * 2
    bus.run(1)
    assert len(bus.sent(0xEC00)) == 1
    bus.say(CM_TO, abort(AbortReason.RESOURCES)[1])
    assert len(bus.sent(0xEC00)) == 2


@pytest.mark.parametrize("size", [8, 1786])
def test_what_cannot_be_transported_is_refused(ecu, bus, size):
    with pytest.raises(ValueError, match=str(size)):
        ecu.transport.send(COMPONENT, bytes(size), 0x10, bus.now)


@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([CM_TO, DT_TO, 0x1CECFF10, 0x1CEBFF10, 0x18EA6410, 0x18EEFF64]),
            st.binary(max_size=8),
        ),
        max_size=30,
    )
)
def test_no_frames_at_all_make_it_fail(frames):
    ecu = make_ecu(100, arbitrary=True)
    bus = J1939Bus(ecu)
    for can_id, data in frames:
        bus.say(can_id, data.hex())
        bus.run(1)
    for _ in range(4):  # T1, T2, T3 and a retransmission are over
        bus.now += 2_000 * MILLISECOND
        bus.run(1)

    assert ecu.transport.due > bus.now
