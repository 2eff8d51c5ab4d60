"""Where something ends, the last value that counts and the first that does not (CiA 301)."""

import pytest

from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sdo_transfer import check_bound, check_complete

TOO_LONG, TOO_SHORT, TOGGLE = 0x06070012, 0x06070013, 0x05030000
TAKEN = (b"\x20".ljust(8, b"\0"), b"\x30".ljust(8, b"\0"))  # by toggle bit
TEXT = "202000"  # 0x2020.00, VISIBLE_STRING "abc"
MICROSECOND = 1000  # [ns]


def code(answer):
    """The abort code of an answer, None where it is none."""
    return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else None


def ask(rig, text):
    """Send one SDO request and return the answer."""
    (answer,) = rig.request(bytes.fromhex(text).ljust(8, b"\0"))
    return answer


def download(rig, announced, data):
    """Download to the text in segments; return the last answer."""
    size = announced.to_bytes(4, "little").hex()
    assert ask(rig, f"21{TEXT}{size}")[0] == 0x60
    answer = b""
    chunks = [data[start : start + 7] for start in range(0, len(data), 7)] or [b""]
    for number, chunk in enumerate(chunks):
        command = (number & 1) << 4 | (7 - len(chunk)) << 1 | (number == len(chunks) - 1)
        answer = ask(rig, bytes([command]).hex() + chunk.hex())
    return answer


@pytest.mark.parametrize(
    ("length", "announced", "abort"),
    [
        *((8, 9, TOO_SHORT), (9, 9, None), (0, 1, TOO_SHORT), (0, 0, None), (1, 1, None)),
        *((0, None, None), (5, None, None)),
    ],
)
def test_a_transfer_is_complete_with_the_last_byte_that_was_announced(length, announced, abort):
    try:
        check_complete(length, announced)
        found = None
    except SdoAbort as error:
        found = error.code
    assert found == abort


@pytest.mark.parametrize(("length", "abort"), [(8, None), (9, None), (10, TOO_LONG)])
def test_a_transfer_fits_up_to_its_bound(length, abort):
    try:
        check_bound(length, 9)
        found = None
    except SdoAbort as error:
        found = error.code
    assert found == abort


@pytest.mark.parametrize("announced", [5, 7, 8, 14, 15])
@pytest.mark.parametrize(("more", "abort"), [(-1, TOO_SHORT), (0, None), (1, TOO_LONG)])
def test_a_segmented_download_has_the_announced_length_and_no_other(rig, announced, more, abort):
    data = b"0123456789abcdef"[: announced + more]
    assert code(download(rig, announced, data)) == abort
    right = data if abort is None else b"abc"
    assert rig.node.object_dictionary.upload(0x2020, 0) == right


@pytest.mark.parametrize(("more", "abort"), [(-1, TOO_SHORT), (0, None)])
def test_a_block_download_has_the_announced_length(rig, more, abort):
    data = b"0123456789"[: 9 + more]
    assert ask(rig, f"c2{TEXT}09000000")[0] & 0xFB == 0xA0  # 9 bytes announced, no CRC
    rig.receive(0x605, b"\x01" + data[:7])
    confirmed = ask(rig, (b"\x82" + data[7:]).hex())
    assert confirmed[:2] == b"\xa2\x02"  # both segments
    end = ask(rig, bytes([0xC1 | (14 - len(data)) << 2]).hex())
    assert (code(end), end[0]) == ((None, 0xA1) if abort is None else (abort, 0x80))


def test_the_toggle_bit_of_a_download_alternates(rig):
    assert ask(rig, f"20{TEXT}")[0] == 0x60
    assert ask(rig, "00" + b"1234567".hex()) == TAKEN[0]
    assert ask(rig, "10" + b"1234567".hex()) == TAKEN[1]
    assert ask(rig, "00" + b"1234567".hex()) == TAKEN[0]
    assert ask(rig, "1d" + b"8".hex()) == TAKEN[1]
    assert rig.node.object_dictionary.upload(0x2020, 0) == b"1234567" * 3 + b"8"


@pytest.mark.parametrize("right", [0, 1, 2])
@pytest.mark.parametrize("is_last", [0, 1])
def test_the_toggle_bit_of_a_download_that_does_not_alternate_ends_it(rig, right, is_last):
    ask(rig, f"20{TEXT}")
    for number in range(right):
        assert ask(rig, f"{(number & 1) << 4:02x}" + b"1234567".hex()) == TAKEN[number & 1]
    wrong = (right + 1 & 1) << 4 | is_last
    assert code(ask(rig, f"{wrong:02x}" + b"1234567".hex())) == TOGGLE
    assert rig.node.object_dictionary.upload(0x2020, 0) == b"abc"


@pytest.mark.parametrize("right", [0, 1, 2])
def test_the_toggle_bit_of_an_upload_that_does_not_alternate_ends_it(rig, right):
    rig.node.object_dictionary.variable(0x2020).value = "x" * 21  # three segments, the third last
    ask(rig, f"40{TEXT}")
    for number in range(right):
        assert ask(rig, f"{0x60 | (number & 1) << 4:02x}")[0] >> 4 == number & 1
    assert code(ask(rig, f"{0x60 | (right + 1 & 1) << 4:02x}")) == TOGGLE
    assert code(ask(rig, f"{0x60 | (right & 1) << 4:02x}")) == 0x05040001  # it is over


@pytest.mark.parametrize(
    ("can_id", "index"),
    # RPDO 1: 16 + 16 bit; RPDO 2: 24 + 1 bit, synchronous. Four bytes both.
    [(0x205, 0x2000), (0x305, 0x2002)],
)
@pytest.mark.parametrize(
    ("length", "is_written", "emcy"),
    # CiA 301: too short is not processed, 8210; too long is processed, 8220.
    [(3, False, 0x8210), (4, True, None), (5, True, 0x8220), (8, True, 0x8220)],
)
def test_an_rpdo_is_processed_from_its_mapped_length_on(
    rig, can_id, index, length, is_written, emcy
):
    rig.receive(0x000, b"\x01\x05")
    rig.run()
    rig.receive(can_id, b"\x01".ljust(length, b"\0"))
    rig.receive(0x080, b"")
    codes = [int.from_bytes(f.data[:2], "little") for f in rig.run() if f.can_id == 0x085]
    assert rig.node.object_dictionary.variable(index).value == int(is_written)
    assert codes == ([] if emcy is None else [emcy])


def test_an_rpdo_of_the_right_length_is_processed_again_after_a_short_one(rig):
    rig.receive(0x000, b"\x01\x05")
    rig.run()
    rig.receive(0x205, b"\x01\0\0")
    rig.receive(0x205, b"\x02\0\0\0")
    codes = [int.from_bytes(f.data[:2], "little") for f in rig.run() if f.can_id == 0x085]
    assert rig.node.object_dictionary.variable(0x2000).value == 2
    assert codes == [0x8210, 0x0000]


class Window:
    """A node whose synchronous window is 500 us, with the SYNC of time 0 taken."""

    def __init__(self, rig):
        dictionary = rig.node.object_dictionary
        dictionary.download(0x1007, 0, (500).to_bytes(4, "little"))
        dictionary.download(0x1801, 2, b"\x01")
        rig.receive(0x000, b"\x01\x05")
        rig.run()
        self.node, self.start = rig.node, rig.now
        self.sync(0)

    def sync(self, now):
        self.node.receive(Frame(0x080), self.start + now)

    @property
    def late(self):
        return self.node.counters.late_synchronous_pdos


@pytest.mark.parametrize(
    ("time", "is_late"),
    [(0, False), (500 * MICROSECOND - 1, False), (500 * MICROSECOND, False), (500_001, True)],
)
def test_an_rpdo_counts_up_to_the_end_of_the_window(rig, time, is_late):
    window = Window(rig)
    window.node.transmit_pdos(window.start, [].append)
    window.node.receive(Frame(0x305, b"\x07\0\0\0"), window.start + time)
    window.sync(2_000_000)
    assert rig.node.object_dictionary.variable(0x2002).value == (0 if is_late else 7)
    assert window.late == is_late


@pytest.mark.parametrize(
    ("time", "is_late"),
    [(0, False), (500 * MICROSECOND - 1, False), (500 * MICROSECOND, False), (500_001, True)],
)
def test_a_tpdo_goes_up_to_the_end_of_the_window(rig, time, is_late):
    window, sent = Window(rig), []
    window.node.transmit_pdos(window.start + time, sent.append)
    assert [frame.can_id for frame in sent] == ([] if is_late else [0x285])
    assert window.late == is_late


# What a transfer leaves behind: nothing (CiA 301, SDO protocols).


UNKNOWN_COMMAND = 0x05040001


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
