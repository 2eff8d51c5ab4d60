import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device.sdo import BUFFER_SIZE, QUEUE_LENGTH

REQUESTS = st.one_of(
    # Block transfers (5 and 6) have rules of their own: test_sdo_dialogue.
    st.binary(min_size=8, max_size=8).filter(lambda request: request[0] >> 5 not in {5, 6}),
    # Requests that hit objects of the test device, so that transfers come about.
    st.builds(
        lambda command, index, subindex, data: (
            bytes([command]) + index.to_bytes(2, "little") + bytes([subindex]) + data
        ),
        st.sampled_from([0x40, 0x20, 0x21, 0x22, 0x23, 0x27, 0x2B, 0x2F]),
        st.sampled_from([0x1003, 0x1008, 0x1017, 0x1600, 0x1800, 0x2020, 0x2021, 0x2024, 0x2030]),
        st.integers(0, 3),
        st.binary(min_size=4, max_size=4),
    ),
    st.builds(
        lambda command, data: bytes([command]) + data,
        st.sampled_from([0x00, 0x10, 0x01, 0x11, 0x60, 0x70]),
        st.binary(min_size=7, max_size=7),
    ),
)


def is_legal(answer):
    """Whether it is a server's answer of CiA 301: an abort, or an scs with its reserved bits 0."""
    command = answer[0]
    if len(answer) != 8:
        return False
    if command == 0x80:
        return int.from_bytes(answer[4:], "little") >> 24 in {0x05, 0x06, 0x08}
    scs, rest = command >> 5, command & 0x1F
    if scs == 3:  # initiate download
        return rest == 0 and answer[4:] == bytes(4)
    if scs == 1:  # download segment
        return rest & 0x0F == 0 and answer[1:] == bytes(7)
    if scs == 2:  # initiate upload: expedited with a size, or a size alone
        return rest & 0x13 == 0x03 or rest == 0x01
    return scs == 0  # upload segment: toggle, number of unused bytes, last


@given(requests=st.lists(REQUESTS, max_size=30))
def test_each_request_gets_one_legal_answer(make_rig, requests):
    rig = make_rig()
    for request in requests:
        answers = rig.request(request)
        assert len(answers) == (0 if request[0] >> 5 == 4 else 1)
        assert all(map(is_legal, answers))


@given(data=st.binary(max_size=200))
def test_download_and_upload_in_segments(make_rig, data):
    rig = make_rig()
    multiplexer = bytes.fromhex("212000")  # 0x2021, DOMAIN
    size = len(data).to_bytes(4, "little")

    assert rig.request(b"\x21" + multiplexer + size)[0][0] == 0x60
    chunks = [data[start : start + 7] for start in range(0, len(data), 7)] or [b""]
    for number, chunk in enumerate(chunks):
        command = number % 2 << 4 | (7 - len(chunk)) << 1 | (number == len(chunks) - 1)
        assert rig.request(bytes([command]) + chunk.ljust(7, b"\0"))[0][0] == 0x20 | number % 2 << 4

    assert rig.node.object_dictionary.variable(0x2021).value == data
    assert upload(rig, b"\x40" + multiplexer + bytes(4)) == data


def upload(rig, request):
    """An SDO client after CiA 301: expedited, or segments until the last."""
    answer = rig.request(request)[0]
    if answer[0] & 0x02:
        return answer[4 : 8 - (answer[0] >> 2 & 3)]
    data, toggle, is_last, count = b"", 0, False, 0
    while not is_last:
        segment = rig.request(bytes([0x60 | toggle]) + bytes(7))[0]
        assert segment[0] & 0x10 == toggle
        data += segment[1 : 8 - (segment[0] >> 1 & 7)]
        is_last = bool(segment[0] & 1)
        toggle ^= 0x10
        count += 1
    assert len(data) == int.from_bytes(answer[4:], "little")
    assert count == max(-(-len(data) // 7), 1)
    return data


def test_queue_is_bounded(rig):
    request = bytes.fromhex("4000100000000000")
    for _ in range(QUEUE_LENGTH + 3):
        rig.receive(0x605, request)
    assert len(rig.run()) == QUEUE_LENGTH
    assert rig.node.counters.dropped_sdo_requests == 3


def test_download_of_unknown_length_is_bounded(rig):
    rig.request(bytes.fromhex("2021200000000000"))
    taken = 0
    for number in range(BUFFER_SIZE):
        (answer,) = rig.request(bytes([number % 2 << 4]) + bytes(7))
        if answer[0] == 0x80:
            break
        taken += 7
    assert answer == bytes.fromhex("8021200012000706")  # length of service parameter too high
    assert BUFFER_SIZE - 7 < taken <= BUFFER_SIZE


SEGMENT_REQUESTS = [bytes([0x60 | toggle]) + bytes(7) for toggle in (0x00, 0x10)]
TWENTY_BYTES = bytes(range(20))
# Of the twenty bytes: two full segments, then six bytes, one unused (0x02), the last (0x01).
SEGMENTS = [
    b"\x00" + TWENTY_BYTES[:7],
    b"\x10" + TWENTY_BYTES[7:14],
    b"\x03" + TWENTY_BYTES[14:] + b"\0",
]


def begin_upload(rig):
    rig.node.object_dictionary.variable(0x2021).value = TWENTY_BYTES
    assert rig.request(bytes.fromhex("4021200000000000")) == [bytes.fromhex("4121200014000000")]


def test_requests_of_one_round_are_answered_in_their_order(rig):
    begin_upload(rig)
    for toggle in (0, 1, 0):
        rig.receive(0x605, SEGMENT_REQUESTS[toggle])
    rig.receive(0x605, bytes.fromhex("4000100000000000"))
    answers = [frame.data for frame in rig.run()]
    assert answers == [*SEGMENTS, bytes.fromhex("4300100091010000")]


def test_a_segment_is_not_taken_before_what_came_earlier(rig):
    begin_upload(rig)
    rig.receive(0x605, bytes.fromhex("4000100000000000"))  # ends the upload
    rig.receive(0x605, SEGMENT_REQUESTS[0])
    answers = [frame.data for frame in rig.run()]
    assert answers == [bytes.fromhex("4300100091010000"), bytes.fromhex("8000000001000405")]


def test_segments_asked_for_at_once_are_bounded(rig):
    rig.node.object_dictionary.variable(0x2021).value = bytes(7 * 400)
    rig.request(bytes.fromhex("4021200000000000"))
    for number in range(400):
        rig.receive(0x605, SEGMENT_REQUESTS[number % 2])
    # One that was ready, and those that waited.
    assert len(rig.run()) == 1 + QUEUE_LENGTH
    assert rig.node.counters.dropped_sdo_requests == 400 - 1 - QUEUE_LENGTH


def test_a_segment_is_sent_in_its_round_only(rig):
    begin_upload(rig)
    rig.receive(0x605, SEGMENT_REQUESTS[0])
    assert rig.sent[-1].data[0] == 0x41  # nothing but the answer to the first request
    assert [frame.data for frame in rig.run()] == SEGMENTS[:1]
    assert rig.run() == []


def test_a_segment_outlives_the_start_of_the_node(rig):
    begin_upload(rig)
    rig.receive(0x605, SEGMENT_REQUESTS[0])
    rig.receive(0x000, b"\x01\x05")
    assert SEGMENTS[0] in [frame.data for frame in rig.run()]


def test_a_stopped_node_sends_no_segment(rig):
    begin_upload(rig)
    rig.receive(0x605, SEGMENT_REQUESTS[0])
    rig.receive(0x000, b"\x02\x05")
    rig.receive(0x000, b"\x80\x05")  # SDO again, but the request was before
    assert rig.run() == []


@pytest.mark.parametrize("flags", [{"is_remote": True}, {"is_extended": True}])
def test_only_a_data_frame_asks_for_a_segment(rig, flags):
    begin_upload(rig)
    data = b"" if "is_remote" in flags else SEGMENT_REQUESTS[0]
    rig.receive(0x605, data, **flags)
    assert rig.run() == []
    assert rig.node.counters.ignored_frames == 1
    assert rig.request(SEGMENT_REQUESTS[0]) == SEGMENTS[:1]


def test_a_short_frame_asks_for_no_segment(rig):
    begin_upload(rig)
    assert rig.request(SEGMENT_REQUESTS[0][:7]) == []
    assert rig.node.counters.short_sdo_requests == 1
    assert rig.request(SEGMENT_REQUESTS[0]) == SEGMENTS[:1]


@pytest.mark.parametrize(
    ("begin", "segment"),
    [("4021200000000000", "6000000000000000"), ("2121200014000000", "0000000000000000")],
    ids=["upload", "download"],
)
def test_each_segment_puts_the_time_out_off(rig, begin, segment):
    rig.node.object_dictionary.variable(0x2021).value = TWENTY_BYTES
    rig.request(bytes.fromhex(begin))
    rig.run(900)
    assert rig.request(bytes.fromhex(segment))[0][0] != 0x80
    assert rig.run(900) == []
    # A second after the segment: 0504 0000, SDO protocol timed out.
    assert [frame.data for frame in rig.run(100)] == [bytes.fromhex("8021200000000405")]


def test_a_channel_confirms_its_end_where_it_was_asked(rig):
    for subindex, cob_id in ((1, "81060000"), (2, "82060000")):
        rig.request(bytes.fromhex(f"230112{subindex:02x}{cob_id}"))
    rig.receive(0x681, bytes.fromhex("2301120282060080"))  # bit 31: the channel exists no more
    (answer,) = rig.run()
    assert (answer.can_id, answer.data) == (0x682, bytes.fromhex("6001120200000000"))
