"""Our MF4 as two independent readers see it: asammdf, and python-can by way of it.

Skipped where asammdf is not installed; `.ci/run` has an environment with it.
"""

import can
import numpy as np
import pytest

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import TIME, Channel, recording_dtype
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.outside.recording.mdf_writer import MdfFile

asammdf = pytest.importorskip("asammdf")  # after can, or python-can would not find it

CHANNELS = (TIME, Channel("axis1.position", "m"), Channel("axis1.P_A", "Pa"))


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
        ]
    expected = []
    for block in range(3):
        expected += [
            (500 * block, 0x181, bytes([block, 7]), False, False),
            (500 * block, 0x1234567, b"12345678", False, True),
            (500 * block + 1, 0x701, b"", True, True),
        ]
    assert found == expected
