from pathlib import Path

import can
import pytest

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError
from hil_bench.recording.frames import SUFFIXES, FrameFile, read_frames
from hil_bench.recording.logged_frame import LoggedFrame

MILLISECOND = 1_000_000  # [ns]


def logged(can_id: int, data: bytes, milliseconds: int, *, is_received: bool = True) -> LoggedFrame:
    return LoggedFrame(Frame(can_id, data), milliseconds * MILLISECOND, is_received)


def test_candump_log_is_written_as_candump_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    with FrameFile(path) as file:
        file.write_frames(
            [
                logged(0x201, b"\x07\x00\x00\x20", 1000),
                logged(0x181, b"\x0f\x00", 1001, is_received=False),
                LoggedFrame(Frame(0x12345678, b"\x01", is_extended=True), 1002 * MILLISECOND, True),
                LoggedFrame(Frame(0x701, is_remote=True), 1003 * MILLISECOND, True),
            ]
        )

    # candump -L of can-utils: (seconds) channel ID#DATA, then python-can's R or T: the direction.
    assert path.read_text().splitlines() == [
        "(1.000000) can0 201#07000020 R",
        "(1.001000) can0 181#0F00 T",
        "(1.002000) can0 12345678#01 R",
        "(1.003000) can0 701#R R",
    ]


@pytest.mark.parametrize("suffix", [".asc", ".log"])
def test_a_full_disk_is_told_with_the_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as caught, FrameFile(path) as file:
        file.write_frames([logged(0x201, b"\x07", 1)])

    assert caught.value.filename == str(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_each_format_reads_back_on_the_same_time_base(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    # The first frame comes late: times count from the start, not from it.
    frames = [
        logged(0x181 + tick, bytes([tick]), 1500 + tick, is_received=bool(tick % 2))
        for tick in range(3)
    ]
    with FrameFile(path) as file:
        file.write_frames(frames[:2])
        file.flush(durable=True)
        file.write_frames(frames[2:])

    assert list(read_frames(path)) == frames
    with can.LogReader(path) as reader:
        found = [(m.arbitration_id, bytes(m.data), m.is_rx) for m in reader]
    assert found == [(0x181, b"\x00", False), (0x182, b"\x01", True), (0x183, b"\x02", False)]


def test_an_unknown_suffix_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for name, suffix in (("bus.pcap", ".pcap"), ("bus", ""), ("bus.log.gz", ".gz")):
        with pytest.raises(ConfigError) as caught:
            FrameFile(tmp_path / name)
        assert str(caught.value) == (
            f'{tmp_path}/{name}: no format has the suffix "{suffix}"; '
            "give a file name that ends in one of .asc .blf .log"
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_directory_that_is_not_there_is_refused_at_once(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(ConfigError) as caught:
        FrameFile(tmp_path / "no" / f"bus{suffix}")

    assert str(caught.value) == (
        f"{tmp_path}/no/bus{suffix}: cannot be written: No such file or directory; "
        "give a file in a directory of yours"
    )


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.log", b"no log at all\n"), ("x.blf", b"no log at all"), ("x.mf4", b"nor this")],
)
def test_a_file_that_is_no_log_says_so(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=rf"^{path}: "):
        list(read_frames(path))


def test_a_missing_log_says_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        list(read_frames(tmp_path / "no.log"))
    assert str(caught.value) == (
        f"{tmp_path}/no.log: cannot be read: No such file or directory; give a log of frames"
    )


@pytest.mark.parametrize(("suffix", "place"), [(".log", "can1 181#2A R"), (".asc", " 2  181 ")])
def test_a_frame_of_another_bus_has_its_channel(tmp_path: Path, suffix: str, place: str) -> None:
    path = tmp_path / f"bus{suffix}"
    with FrameFile(path) as file:
        file.write_frames([LoggedFrame(Frame(0x181, b"\x2a", bus=1), MILLISECOND, True)])
    assert place in path.read_text()
