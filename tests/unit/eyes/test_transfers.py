"""SDO transfers from frames; commands and flags are those of CiA 301, clause 7.2.4.3."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.sdo_frames import MS, answer, heard, request

from hil_bench.abilities.eyes.transfers import AT_ONCE, PATIENCE, SdoChannel, Way

TEXT = b"HIL bench valve"  # 15 bytes: segments of 7, 7 and 1

SEGMENTED_UPLOAD = [
    request(1, "40 08 10 00"),
    answer(1, "41 08 10 00 0F 00 00 00"),
    request(1, "60"),
    answer(1, "00" + TEXT[:7].hex()),
    request(1, "70"),
    answer(1, "10" + TEXT[7:14].hex()),
    request(1, "60"),
    answer(1, "0D" + TEXT[14:].hex()),  # n = 6 unused, c = 1
]
SEGMENTED_DOWNLOAD = [
    request(1, "21 00 20 00 09 00 00 00"),
    answer(1, "60 00 20 00"),
    request(1, "00 31 32 33 34 35 36 37"),
    answer(1, "20"),
    request(1, "1B 38 39"),  # toggle, n = 5, c
    answer(1, "30"),
]
BLOCK_DOWNLOAD = [
    request(1, "C6 00 20 01 09 00 00 00"),
    answer(1, "A4 00 20 01 7F"),
    request(1, "01 31 32 33 34 35 36 37"),
    request(1, "82 38 39"),
    answer(1, "A2 02 7F"),
    request(1, "D5"),  # n = 5
    answer(1, "A1"),
]
BLOCK_UPLOAD = [
    request(1, "A4 00 20 01 7F"),
    answer(1, "C6 00 20 01 09 00 00 00"),
    request(1, "A3"),
    answer(1, "01 31 32 33 34 35 36 37"),
    answer(1, "82 38 39"),
    request(1, "A2 02 7F"),
    answer(1, "D5"),
    request(1, "A1"),
]
BLOCK_SENT_AGAIN = [
    *BLOCK_DOWNLOAD[:4],
    answer(1, "A2 01 7F"),  # the second was lost: it alone comes again, as the first of its block
    request(1, "81 38 39"),
    answer(1, "A2 01 7F"),
    *BLOCK_DOWNLOAD[5:],
]


def hear(frames):
    channel, ended = SdoChannel(), []
    for logged in heard(*frames):
        is_request = logged.frame.can_id >= 0x600
        ended += channel.hear(logged.frame.data, logged.now, is_request=is_request)
    return channel, ended


@pytest.mark.parametrize(
    ("frames", "way", "place", "data"),
    [
        (SEGMENTED_UPLOAD, Way.UPLOAD, "0x1008.00", TEXT),
        (SEGMENTED_DOWNLOAD, Way.DOWNLOAD, "0x2000.00", b"123456789"),
        (BLOCK_DOWNLOAD, Way.DOWNLOAD, "0x2000.01", b"123456789"),
        (BLOCK_UPLOAD, Way.UPLOAD, "0x2000.01", b"123456789"),
        (BLOCK_SENT_AGAIN, Way.DOWNLOAD, "0x2000.01", b"123456789"),
        ([request(1, "40 17 10 00"), answer(1, "4B 17 10 00 64 00")], Way.UPLOAD, "0x1017.00",
         b"\x64\0"),
        ([request(1, "22 00 20 00 01 02"), answer(1, "60 00 20 00")], Way.DOWNLOAD, "0x2000.00",
         b"\x01\x02\0\0"),  # without the size bit: all four
    ],
)  # fmt: skip
def test_a_transfer_is_put_together(frames, way, place, data):
    channel, ended = hear(frames)
    (transfer,) = ended
    assert (transfer.way, transfer.place, bytes(transfer.data)) == (way, place, data)
    assert transfer.is_done
    assert not transfer.is_short
    assert transfer.frames == len(frames)
    assert transfer.end - transfer.begin == (len(frames) - 1) * MS
    assert channel.current is None


def test_an_abort_ends_it_and_says_who():
    _, (transfer,) = hear([*SEGMENTED_UPLOAD[:3], request(1, "80 08 10 00 00 00 04 05")])
    assert (transfer.abort, transfer.is_aborted_by_client) == (0x05040000, True)
    _, (transfer,) = hear([BLOCK_DOWNLOAD[0], answer(1, "80 00 20 01 02 00 01 06")])
    assert (transfer.abort, transfer.is_aborted_by_client) == (0x06010002, False)


def test_an_abort_in_the_middle_of_a_block_is_no_segment():
    _, (transfer,) = hear([*BLOCK_DOWNLOAD[:3], request(1, "80 00 20 01 00 00 00 08")])
    assert transfer.abort == 0x08000000


def test_less_than_announced_is_short():
    frames = [*SEGMENTED_UPLOAD]
    frames[1] = answer(1, "41 08 10 00 10 00 00 00")
    _, (transfer,) = hear(frames)
    assert transfer.is_short


def test_the_same_request_again_ends_one_that_was_not_answered():
    channel, (transfer,) = hear([request(1, "40 00 10 00"), request(1, "40 00 10 00")])
    assert (transfer.place, transfer.has_ended, transfer.is_overtaken) == (
        "0x1000.00",
        False,
        False,
    )
    assert channel.current.place == "0x1000.00"


def test_a_later_request_ends_one_that_was_not_answered():
    channel = SdoChannel()
    first, second = request(1, "40 00 10 00").data, request(1, "40 01 10 00").data
    assert channel.hear(first, 0, is_request=True) == ()
    (transfer,) = channel.hear(second, AT_ONCE, is_request=True)
    assert (transfer.place, transfer.is_overtaken) == ("0x1000.00", False)


@pytest.mark.parametrize("is_in_order", [True, False])
def test_two_clients_at_once_each_get_their_answer(is_in_order):
    """A read of 0x1000 and a write of 0x1017, both sent before an answer came."""
    answers = [answer(1, "43 00 10 00 92 01 02 00"), answer(1, "60 17 10 00")]
    asked = [request(1, "40 00 10 00"), request(1, "2B 17 10 00 64 00")]
    channel, ended = hear([*asked, *(answers if is_in_order else reversed(answers))])
    found = {each.place: each for each in ended}
    assert set(found) == {"0x1000.00", "0x1017.00"}
    assert all(each.is_done for each in ended)
    assert bytes(found["0x1000.00"].data) == b"\x92\x01\x02\0"
    assert found["0x1000.00"].is_overtaken
    assert not found["0x1017.00"].is_overtaken
    assert (channel.current, channel.overtaken) == (None, None)


def test_a_third_request_ends_the_first():
    channel, (first,) = hear([request(1, f"40 {sub:02X} 10 00") for sub in range(3)])
    assert (first.place, first.has_ended) == ("0x1000.00", False)
    assert [each.place for each in channel.finish()] == ["0x1001.00", "0x1002.00"]


def test_a_silent_one_expires_after_its_patience():
    channel, _ = hear([request(1, "40 00 10 00")])
    assert channel.expire(PATIENCE - 1) == ()
    (transfer,) = channel.expire(PATIENCE)
    assert transfer.place == "0x1000.00"
    assert channel.current is None


def test_an_overtaken_one_expires_after_its_own():
    channel, _ = hear([request(1, "40 00 10 00"), request(1, "40 01 10 00")])
    assert [each.place for each in channel.expire(PATIENCE)] == ["0x1000.00"]
    assert [each.place for each in channel.expire(PATIENCE + MS)] == ["0x1001.00"]


@given(st.lists(st.tuples(st.booleans(), st.binary(min_size=8, max_size=8)), max_size=30))
def test_no_bytes_make_it_stumble(frames):
    channel = SdoChannel()
    for number, (is_request, data) in enumerate(frames):
        channel.hear(data, number, is_request=is_request)
