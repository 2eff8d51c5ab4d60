"""MF4 as we write and read it; `.ci/run` has asammdf and python-can read the same."""

import re
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from hil_bench import ConfigError, read_frames
from hil_bench.abilities.recording import mdf_reader
from hil_bench.abilities.recording.mdf_blocks import DG_DATA, pack_block
from hil_bench.abilities.recording.mdf_reader import read_mdf
from hil_bench.abilities.recording.mdf_writer import MdfFile
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    LoggedFrame,
    recording_channels,
    recording_dtype,
)

CHANNELS = (TIME, Channel("axis1.position", "m"), Channel("axis1.P_A", "Pa"))
FRAMES = [
    LoggedFrame(Frame(0x181, b"\x01\x02"), 1_000_000, False),
    LoggedFrame(Frame(0x701, is_remote=True), 2_000_000, True),
    LoggedFrame(Frame(0x1234567, b"12345678", is_extended=True), 3_000_000, True),
    LoggedFrame(Frame(0x80, bus=2), 3_000_000, True),
]
# CAN_ERR_PROT | CAN_ERR_BUSERROR | CAN_ERR_CNT of linux/can/error.h, on the second bus.
ERROR = LoggedFrame(Frame(ERROR_FLAG | 0x288, b"\0\0\4\0\0\0\0\3", bus=1), 4_000_000, True)


def rows(first, after):
    result = np.zeros(after - first, dtype=recording_dtype(CHANNELS))
    numbers = np.arange(first, after)
    result["time"], result["axis1.position"] = numbers * 1e-3, np.sin(numbers)
    result["axis1.P_A"] = 1e5 * numbers
    return result


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "run.mf4"
    file = MdfFile(path, CHANNELS, comment="a < b")
    file.write_rows(rows(0, 10))
    file.write_frames(FRAMES)
    file.write_rows(rows(10, 17))
    file.close()
    return path


@pytest.fixture
def path_with_errors(tmp_path):
    path = tmp_path / "errors.mf4"
    file = MdfFile(path, CHANNELS)
    for block in (FRAMES, [ERROR, *FRAMES], [ERROR, ERROR]):
        file.write_frames(block)
        file.flush(durable=False)
    file.close()
    return path


@pytest.mark.parametrize(
    ("largest", "count"), [(17 * 24 - 1, 2), (1 << 30, 100)], ids=["too-much", "twice"]
)
def test_a_small_file_does_not_fill_the_memory(path, monkeypatch, largest, count):
    content = path.read_bytes()
    lists, first = content.index(b"##DL"), content.index(b"##DZ")
    assert len(read_recording(path)) == 17  # of 24 bytes
    monkeypatch.setattr(mdf_reader, "_LARGEST", largest)
    if count > 2:
        block = pack_block(b"##DL", (0, *[first] * count), bytes(8))
        link, end = struct.pack("<Q", lists), struct.pack("<Q", len(content))
        path.write_bytes(content.replace(link, end, 1) + block)
    with pytest.raises(ConfigError, match=r"is listed twice|unfold to more than"):
        read_recording(path)


def test_signals_and_frames_read_back(path):
    assert read_recording(path).tolist() == rows(0, 17).tolist()
    assert recording_channels(read_recording(path)) == CHANNELS
    assert sorted(read_frames(path)) == sorted(FRAMES)


def test_error_frames_read_back_and_only_a_file_that_has_some_has_their_group(
    path, path_with_errors
):
    assert b"CAN_ErrorFrame" not in path.read_bytes()
    assert path_with_errors.read_bytes().count(b"CAN_ErrorFrame.ErrorType\0") == 1
    frames = list(read_frames(path_with_errors, errors=True))
    assert sorted(frames) == sorted([*FRAMES, *FRAMES, ERROR, ERROR, ERROR])


def test_a_group_of_frames_that_we_do_not_write_is_refused(path):
    path.write_bytes(path.read_bytes().replace(b"CAN_RemoteFrame\0", b"CAN_OtherXFrame\0"))
    with pytest.raises(ConfigError, match="a group of frames is none of ours"):
        read_mdf(path)


def test_data_that_contradict_their_check_sum_are_refused(path):
    """RFC 1950: Adler-32 ends a block; numbers of a damaged one are anything."""
    content = bytearray(path.read_bytes())
    block = content.index(b"##DZ")
    (packed,) = struct.unpack_from("<Q", content, block + 24 + 16)
    content[block + 24 + 24 + packed - 1] ^= 1
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"damaged: .* does not unpack \(.*incorrect data check"):
        read_mdf(path)


def test_a_second_group_of_signals_is_refused(tmp_path):
    """As of another tool, for signals of another rate: either group would hide the other."""
    path = tmp_path / "two.mf4"
    file = MdfFile(path, CHANNELS)
    file.write_rows(rows(0, 10))
    file.close()
    content = bytearray(path.read_bytes())
    groups = [each.start() for each in re.finditer(b"##DG", content)]
    links = {each: struct.unpack_from("<4Q", content, each + 24) for each in groups}
    (signals,) = (each for each in groups if links[each][2])  # has data
    (last,) = (each for each in groups if not links[each][0])
    content[last + 24 : last + 32] = struct.pack("<Q", len(content))
    path.write_bytes(content + pack_block(b"##DG", (0, *links[signals][1:]), DG_DATA.pack(0, b"")))
    with pytest.raises(ConfigError, match="it has several groups of signals"):
        read_mdf(path)


def test_a_file_without_data_reads_back(tmp_path):
    MdfFile(tmp_path / "x.mf4", CHANNELS).close()
    signals, frames = read_mdf(tmp_path / "x.mf4")
    assert (len(signals), frames) == (0, [])
    assert recording_channels(signals) == CHANNELS


@example(place=0.8109828979357279, byte=0, end=1.0)  # a block whose links are counted as none
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1), byte=st.integers(0, 255), end=st.floats(0, 1))
def test_a_damaged_file_is_read_or_refused_in_one_line(
    path_with_errors, make_file, place, byte, end
):
    content = bytearray(path_with_errors.read_bytes())
    content[int(place * (len(content) - 1))] = byte
    damaged = make_file("damaged.mf4", content[: len(content) - int((1 - end**0.1) * len(content))])
    message = ""
    try:
        read_mdf(damaged)
    except ConfigError as error:
        message = str(error)
    expected = (f"{damaged}: is no recording of hil-bench: ", f"{damaged}: is cut off or damaged: ")
    assert not message or message.startswith(expected)
    assert "\n" not in message


def test_blocks_in_a_circle_are_refused(path):
    content = bytearray(path.read_bytes())
    group = content.index(b"##DG")
    content[group + 24 : group + 32] = group.to_bytes(8, "little")  # its link to the next
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="linked in a circle"):
        read_mdf(path)
