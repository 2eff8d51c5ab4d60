from pathlib import Path

import can
import pytest

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError
from hil_bench.recording.frames import SUFFIXES, FrameFile

MILLISECOND = 1_000_000  # [ns]


def test_candump_log_is_written_as_candump_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    with FrameFile(path, channel="vcan0") as file:
        file.append(Frame(0x201, b"\x07\x00\x00\x20"), 1000 * MILLISECOND, is_received=True)
        file.append(Frame(0x181, b"\x0f\x00"), 1001 * MILLISECOND, is_received=False)
        file.append(
            Frame(0x12345678, b"\x01", is_extended=True), 1002 * MILLISECOND, is_received=True
        )
        file.append(Frame(0x701, is_remote=True), 1003 * MILLISECOND, is_received=True)

    # candump -L of can-utils: (seconds) channel ID#DATA, then python-can's R or T: the direction.
    assert path.read_text().splitlines() == [
        "(1.000000) vcan0 201#07000020 R",
        "(1.001000) vcan0 181#0F00 T",
        "(1.002000) vcan0 12345678#01 R",
        "(1.003000) vcan0 701#R R",
    ]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_each_format_reads_back_with_python_can(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    with FrameFile(path) as file:
        for tick in range(3):
            file.append(Frame(0x181 + tick, bytes([tick])), tick * MILLISECOND, is_received=True)
    with can.LogReader(path) as reader:
        messages = [(m.arbitration_id, bytes(m.data), m.timestamp) for m in reader]

    times = [pytest.approx(tick * 1e-3, abs=1e-6) for tick in range(3)]
    assert messages == [
        (0x181, b"\x00", times[0]),
        (0x182, b"\x01", times[1]),
        (0x183, b"\x02", times[2]),
    ]


def test_an_unknown_suffix_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for name, suffix in (("bus.pcap", ".pcap"), ("bus", ""), ("bus.log.gz", ".gz")):
        with pytest.raises(ConfigError) as caught:
            FrameFile(tmp_path / name)
        assert str(caught.value) == (
            f'{tmp_path}/{name}: no format has the suffix "{suffix}"; '
            "give a file name that ends in one of .asc .blf .csv .log .trc"
        )
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_is_not_there_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        FrameFile(tmp_path / "no" / "bus.log")

    assert str(caught.value) == (
        f"{tmp_path}/no/bus.log: cannot be written: No such file or directory; "
        "give a file in a directory of yours"
    )


def test_the_oldest_frames_make_room_and_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    with FrameFile(path, capacity=2) as file:
        for tick in range(5):
            file.append(Frame(0x180 + tick), tick * MILLISECOND, is_received=True)
        assert file.dropped == 3

    assert [line.split()[2] for line in path.read_text().splitlines()] == ["183#", "184#"]
