"""What a transfer leaves behind: nothing (CiA 301, SDO protocols)."""

import pytest

UNKNOWN_COMMAND = 0x05040001


def ask(rig, text):
    (answer,) = rig.request(bytes.fromhex(text).ljust(8, b"\0"))
    return answer


def answers_until_time_out(rig):
    """Wait longer than an SDO time-out; return what the server says of itself."""
    return [frame for _ in range(30) for frame in rig.run(1000) if frame.can_id == 0x585]


@pytest.mark.parametrize(
    "dialogue",
    [
        ["c2 2020 00 03000000", "81 616263", "d1"],  # block download of 3 bytes
        ["21 2020 00 03000000", "09 616263"],  # download in segments
        ["2b 0020 00 0100"],  # two bytes in one frame
        ["40 2020 00"],  # upload of 3 bytes, expedited
    ],
    ids=["block download", "segmented download", "expedited download", "upload"],
)
def test_a_transfer_that_is_over_times_out_no_more(rig, dialogue):
    for request in dialogue:
        ask(rig, request)
    assert answers_until_time_out(rig) == []


@pytest.mark.parametrize("command", ["00", "10", "01", "60", "70", "c1", "d1", "a1", "a2", "a3"])
def test_a_part_of_a_transfer_that_is_not_there_names_no_object(rig, command):
    # Segments, the end of a block download; start, confirmation and end of a block upload.
    answer = ask(rig, f"{command} 1234 56")
    assert answer == b"\x80\0\0\0" + UNKNOWN_COMMAND.to_bytes(4, "little")


@pytest.mark.parametrize("command", ["e0", "ff"])
def test_an_unknown_command_is_refused_for_the_object_in_it(rig, command):
    answer = ask(rig, f"{command} 3412 56")
    assert answer == bytes.fromhex("80 3412 56") + UNKNOWN_COMMAND.to_bytes(4, "little")


@pytest.mark.parametrize("block_size", [1, 2, 126, 127])
def test_a_sub_block_of_an_upload_has_all_its_segments(rig, block_size):
    # CiA 301, SDO block upload: 1 to 127 segments, numbered from 1.
    text = bytes(32 + place % 90 for place in range(7 * 127 + 1))  # one more than a sub-block holds
    rig.node.object_dictionary.variable(0x2020).value = text.decode("ascii")
    answer = ask(rig, f"a0 2020 00 {block_size:02x}")
    # Server command 6, CRC supported (bit 2), size indicated (bit 1).
    assert answer == bytes.fromhex("c6 2020 00") + len(text).to_bytes(4, "little")
    rig.receive(0x605, b"\xa3".ljust(8, b"\0"))
    segments = [f.data for _ in range(200) for f in rig.run() if f.can_id == 0x585]
    assert [segment[0] for segment in segments] == list(range(1, block_size + 1))
    assert b"".join(segment[1:] for segment in segments) == text[: 7 * block_size]


@pytest.mark.parametrize("size", range(1, 8))
def test_segments_may_be_short_before_the_last_one_too(rig, size):
    # CiA 301, SDO download segment: n, the bytes without data, stands in every segment.
    ask(rig, "20 2020 00")
    for number in range(4):
        toggle, is_last = (number & 1) << 4, number == 3
        command = toggle | (7 - size) << 1 | is_last
        answer = ask(rig, f"{command:02x}" + b"abcdefg"[:size].hex())
        assert answer == bytes([0x20 | toggle]).ljust(8, b"\0")
    assert rig.node.object_dictionary.upload(0x2020, 0) == b"abcdefg"[:size] * 4
