"""Block transfers against a client written from CiA 301 for them, on a bus that loses frames.

The client below shares no code with the server. Its CRC goes bit by bit.
"""

from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device.sdo import BUFFER_SIZE
from hil_bench.canopen_device.sdo_block import SEGMENTS_PER_ROUND

MULTIPLEXER = bytes.fromhex("212000")  # 0x2021, DOMAIN
LENGTHS = st.integers(0, 40) | st.sampled_from([888, 889, 890, 7 * 127, 7 * 128])


def crc(data):
    register = 0
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = register << 1 ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def make_data(length):
    return bytes(number * 7 % 251 for number in range(length))


def test_crc_of_the_client():
    assert crc(b"123456789") == 0x31C3  # check value of CRC-CCITT (XMODEM) in every catalogue


def block_download(rig, data, losses):
    """Download `data`; `losses` says for each segment sent whether the bus loses it."""
    (answer,) = rig.request(b"\xc6" + MULTIPLEXER + len(data).to_bytes(4, "little"))
    assert answer[:4] == b"\xa4" + MULTIPLEXER
    segments = [data[start : start + 7] for start in range(0, len(data), 7)] or [b""]
    first, size = 0, answer[4]
    while first < len(segments):
        confirmation = send_sub_block(rig, segments, first, size, losses)
        assert confirmation[0] == 0xA2
        first, size = first + confirmation[1], confirmation[2]
    unused = 7 * len(segments) - len(data)
    end = bytes([0xC1 | unused << 2]) + crc(data).to_bytes(2, "little") + bytes(5)
    assert rig.request(end) == [b"\xa1" + bytes(7)]


def send_sub_block(rig, segments, first, size, losses):
    """Send up to `size` segments and return the server's confirmation, as long as it takes."""
    sent = segments[first : first + size]
    answers, has_come = [], False
    for number, segment in enumerate(sent, start=1):
        if next(losses):
            continue
        has_come = True
        is_last = first + number == len(segments)
        answers += rig.request(bytes([number | is_last << 7]) + segment.ljust(7, b"\0"))
    if not has_come:  # the server cannot know that there was a sub-block: send it again
        return bytes([0xA2, 0, size])
    (answer,) = answers or [frame.data for frame in rig.run(500)]
    return answer


def lossy(flags):
    """Lose what `flags` says, then nothing more."""
    yield from flags
    while True:
        yield False


@given(length=LENGTHS, flags=st.lists(st.booleans(), max_size=40))
def test_a_block_download_survives_lost_segments(make_rig, length, flags):
    rig = make_rig()
    data = make_data(length)
    block_download(rig, data, lossy(flags))
    assert rig.node.object_dictionary.variable(0x2021).value == data


def block_upload(rig, sizes, losses):
    """Upload with sub-blocks of the given sizes, the last of them for ever."""
    (answer,) = rig.request(b"\xa4" + MULTIPLEXER + bytes([sizes[0]]) + bytes(3))
    assert answer[:4] == b"\xc6" + MULTIPLEXER
    data, is_over, size = b"", False, sizes[0]
    answers = rig.request(b"\xa3" + bytes(7))
    sizes = iter(sizes[1:])
    while not is_over:
        assert len(answers) <= SEGMENTS_PER_ROUND
        expected, came = 1, b""
        for segment in answers + collect(rig):
            if segment[0] & 0x7F == expected and not next(losses):
                expected += 1
                came += segment[1:]
                is_over = bool(segment[0] & 0x80)
        data += came
        size = next(sizes, size)
        answers = rig.request(bytes([0xA2, expected - 1, size]) + bytes(5))
    (end,) = answers
    assert end[0] & 0xE3 == 0xC1
    assert rig.request(b"\xa1" + bytes(7)) == []
    data = data[: len(data) - (end[0] >> 2 & 7)]
    assert int.from_bytes(end[1:3], "little") == crc(data)
    assert int.from_bytes(answer[4:], "little") == len(data)
    return data


def collect(rig):
    """Run until the server waits for the client."""
    answers = []
    while True:
        sent = [frame.data for frame in rig.run()]
        assert len(sent) <= SEGMENTS_PER_ROUND
        if not sent:
            return answers
        answers += sent


@given(
    length=LENGTHS,
    sizes=st.lists(st.integers(1, 127), min_size=1, max_size=5),
    flags=st.lists(st.booleans(), max_size=20),
)
def test_a_block_upload_survives_lost_segments(make_rig, length, sizes, flags):
    rig = make_rig()
    data = make_data(length)
    rig.node.object_dictionary.variable(0x2021).value = data
    assert block_upload(rig, sizes, lossy(flags)) == data


def test_the_longest_object_both_ways(rig):
    data = make_data(BUFFER_SIZE)
    block_download(rig, data, lossy([]))
    assert block_upload(rig, [127], lossy([])) == data


def test_a_download_of_unknown_length_is_bounded(rig):
    rig.request(b"\xc0" + MULTIPLEXER + bytes(4))
    taken = 0
    while True:
        for number in range(1, 128):
            answers = rig.request(bytes([number]) + bytes(7))
            if answers and answers[0][0] == 0x80:
                # Length of service parameter too high; up to 7 bytes could have been unused.
                assert answers == [bytes.fromhex("8021200012000706")]
                assert taken <= BUFFER_SIZE + 7 < taken + 7
                return
            taken += 7
