"""Our MF4 as two independent readers see it: asammdf, and python-can by way of it.

Skipped where asammdf is not installed; `.ci/run` has an environment with it.
"""

import can
import numpy as np
import pytest

from hil_bench.abilities.recording.mdf_writer import MdfFile
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import ERROR_FLAG
from hil_bench.outside.recording.channels import TIME, Channel, LoggedFrame, recording_dtype

asammdf = pytest.importorskip("asammdf")  # after can, or python-can would not find it

CHANNELS = (TIME, Channel("axis1.position", "m"), Channel("axis1.P_A", "Pa"))

# linux/can/error.h: CAN_ERR_PROT | CAN_ERR_BUSERROR | CAN_ERR_CNT with CAN_ERR_PROT_STUFF or
# CAN_ERR_PROT_BIT | CAN_ERR_PROT_TX, the same with CAN_ERR_ACK, and CAN_ERR_BUSOFF.
ERRORS = [
    LoggedFrame(Frame(ERROR_FLAG | can_id, bytes.fromhex(data)), 1_900_000_000, True)
    for can_id, data in (
        (0x288, "0000040000000003"),
        (0x288, "0000810000000800"),
        (0x2A8, "0000810000001000"),
        (0x040, "0000000000000000"),
    )
]


@pytest.fixture(params=["closed", "killed"])
def path(request, tmp_path):
    """A file of three blocks; "killed" is what stands on the disk before it is closed."""
    path = tmp_path / "run.mf4"
    file = MdfFile(path, CHANNELS, comment="seed 1 < 2")
    for block in range(3):
        rows = np.zeros(500, dtype=recording_dtype(CHANNELS))
        rows["time"] = (500 * block + np.arange(500)) * 1e-3
        rows["axis1.position"] = np.sin(rows["time"])
        rows["axis1.P_A"] = 1e5 * rows["time"]
        file.write_rows(rows)
        start = 500_000_000 * block
        file.write_frames(
            [
                LoggedFrame(Frame(0x181, bytes([block, 7])), start, False),
                LoggedFrame(Frame(0x701, is_remote=True), start + 1_000_000, True),
                LoggedFrame(Frame(0x1234567, b"12345678", is_extended=True), start, True),
                *(ERRORS if block else ()),
            ]
        )
        file.flush(durable=False)
    if request.param == "closed":
        file.close()
    yield path
    file.close()


def test_asammdf_reads_signals_with_their_units(path):
    with asammdf.MDF(path) as mdf:
        position, pressure = mdf.get("axis1.position"), mdf.get("axis1.P_A")
        comment = mdf.header.comment
    assert position.timestamps == pytest.approx(np.arange(1500) * 1e-3)
    assert position.samples == pytest.approx(np.sin(np.arange(1500) * 1e-3))
    assert (position.unit, pressure.unit) == ("m", "Pa")
    assert "seed 1 &lt; 2" in comment


def test_python_can_reads_the_frames(path):
    with can.LogReader(path) as reader:
        found = [
            (round(m.timestamp * 1e3), m.arbitration_id, bytes(m.data), m.is_remote_frame, m.is_rx)
            for m in reader
            if not m.is_error_frame
        ]
    expected = []
    for block in range(3):
        expected += [
            (500 * block, 0x181, bytes([block, 7]), False, False),
            (500 * block, 0x1234567, b"12345678", False, True),
            (500 * block + 1, 0x701, b"", True, True),
        ]
    assert found == expected


def test_asammdf_reads_the_kinds_of_errors(path):
    with asammdf.MDF(path) as mdf:
        kinds = mdf.get("CAN_ErrorFrame.ErrorType")
        extended = mdf.get("CAN_ErrorFrame.IDE")
    names = [asammdf.blocks.v4_constants.CAN_ERROR_TYPES[kind] for kind in kinds.samples.tolist()]
    assert [name.strip() for name in names] == [
        "Bit Stuffing Error",
        "Bit Error",
        "Acknowledgment Error",
        "Other/unknown error",
    ] * 2
    assert kinds.timestamps == pytest.approx([1.9] * 8)
    assert extended.samples.tolist() == [1] * 8


def test_python_can_reads_error_frames_as_it_writes_them_itself(path):
    with can.LogReader(path) as reader:
        found = [
            (m.arbitration_id, bytes(m.data), m.channel, m.is_rx)
            for m in reader
            if m.is_error_frame
        ]
    classes = [0x288, 0x288, 0x2A8, 0x040]
    assert found == [
        (can_id, error.frame.data, 1, True)
        for can_id, error in zip(classes * 2, ERRORS * 2, strict=True)
    ]
