"""MF4 with frames of CAN FD: ours as python-can reads them by way of asammdf, and theirs as we do.

Skipped where asammdf is not installed; `.ci/run` has an environment with it.
"""

from pathlib import Path

import can
import pytest

from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.mdf_writer import MdfFile
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.frame import FD_LENGTHS
from hil_bench.outside.messages import message_of
from hil_bench.outside.recording.channels import TIME, LoggedFrame

asammdf = pytest.importorskip("asammdf")  # after can, or python-can would not find it

FRAMES = [
    *(Frame(0x100 + n, bytes(range(n)), fd=FDF | BRS) for n in FD_LENGTHS),
    Frame(0x1ABCDEF0, b"\xff" * 64, is_extended=True, fd=FDF | ESI),
    Frame(0x181, b"\x01\x02"),
    Frame(0x702, is_remote=True),
]


def known(message):
    fields = message.arbitration_id, bytes(message.data), message.is_extended_id
    flags = message.is_fd, message.bitrate_switch, message.error_state_indicator
    return *fields, *flags, message.is_remote_frame


def test_python_can_reads_the_frames_of_ours(tmp_path):
    path = tmp_path / "ours.mf4"
    with MdfFile(path, (TIME,)) as file:
        for number, frame in enumerate(FRAMES):
            file.write_frames([LoggedFrame(frame, number * 1_000_000, is_received=True)])
            file.flush(durable=False)
    with can.LogReader(path) as reader:
        found = [known(message) for message in reader]
    assert found == [known(message_of(frame)) for frame in FRAMES]
    with asammdf.MDF(path) as mdf:
        (dlc,) = [
            mdf.get("CAN_DataFrame.DLC", group, index)
            for group, index in mdf.whereis("CAN_DataFrame.DLC")
            if len(mdf.get("CAN_DataFrame.DLC", group, index)) > 1
        ]
    assert dlc.samples.tolist() == [*range(16), 15]


def test_we_read_the_frames_of_python_can(tmp_path):
    path = Path(tmp_path / "theirs.mf4")
    with can.Logger(path) as logger:
        for number, frame in enumerate(FRAMES):
            message = message_of(frame)
            message.timestamp = number * 1e-3
            logger(message)
    assert [logged.frame for logged in read_frames(path)] == FRAMES
