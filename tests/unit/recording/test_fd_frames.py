"""Frames of CAN FD in logs: ours as strangers read them, theirs as we do."""

import subprocess
from pathlib import Path

import can
import pytest
from support.dissection import dissect, require_tool, require_tshark

from hil_bench.abilities.recording.frames import LeftOut, open_frame_file, read_frames
from hil_bench.abilities.recording.recorder import InlineRecorder, RecordingPlan
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.frame import FD_LENGTHS
from hil_bench.outside.recording.channels import LoggedFrame

MS = 1_000_000
FRAMES = [
    *(Frame(0x100 + n, bytes(range(n)), fd=FDF | BRS) for n in FD_LENGTHS),
    Frame(0x123, b"\x11" * 48, fd=FDF),
    Frame(0x123, b"\x11" * 8, fd=FDF | ESI),
    Frame(0x1ABCDEF0, b"\xff" * 64, is_extended=True, fd=FDF | BRS | ESI),
    Frame(0x181, b"\x01\x02"),
    Frame(0x702, is_remote=True),
]
LOGGED = [LoggedFrame(frame, n * MS, is_received=True) for n, frame in enumerate(FRAMES)]
READ_BY_PYTHON_CAN = [
    (f.can_id, bytes(f.data), f.is_extended, f.fd != 0, f.fd & BRS != 0, f.fd & ESI != 0)
    for f in FRAMES
]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(name):
    with open_frame_file(Path(name)) as file:
        file.write_frames(LOGGED)


def read(name):
    left_out = LeftOut()
    return [logged.frame for logged in read_frames(Path(name), left_out)], left_out


@pytest.mark.parametrize("name", ["f.log", "f.asc", "f.blf"])
def test_frames_of_can_fd_survive_a_file(name):
    write(name)
    assert read(name) == (FRAMES, LeftOut())


def test_frames_of_can_fd_survive_a_recording_and_keep_their_order():
    recorder = InlineRecorder(RecordingPlan((Path("f.mf4"),), ()))
    recorder.start()
    for logged in LOGGED:
        recorder.append_frames([logged.frame], logged.now, is_received=True)
    recorder.stop()
    assert read("f.mf4") == (FRAMES, LeftOut())


@pytest.mark.parametrize("name", ["f.log", "f.asc", "f.blf"])
def test_python_can_reads_ours(name):
    write(name)
    with can.LogReader(name) as reader:
        found = [
            (
                m.arbitration_id,
                bytes(m.data),
                m.is_extended_id,
                m.is_fd,
                m.bitrate_switch,
                m.error_state_indicator,
            )
            for m in reader
        ]
    # Its ASC reader takes a frame of CAN FD without data for a remote one; that has none either.
    assert found == READ_BY_PYTHON_CAN


@pytest.mark.parametrize("name", ["f.log", "f.asc", "f.blf"])
def test_we_read_python_cans(name):
    with can.Logger(name) as logger:
        for logged in LOGGED:
            frame = logged.frame
            logger(
                can.Message(
                    timestamp=logged.now * 1e-9,
                    arbitration_id=frame.can_id,
                    is_extended_id=frame.is_extended,
                    is_remote_frame=frame.is_remote,
                    is_fd=frame.fd != 0,
                    bitrate_switch=frame.fd & BRS != 0,
                    error_state_indicator=frame.fd & ESI != 0,
                    data=frame.data,
                    channel="can0",
                )
            )
    assert read(name) == (FRAMES, LeftOut())


@pytest.mark.parametrize("options", [[], ["-f"]], ids=["plain", "all as CANFD"])
def test_we_read_what_log2asc_makes_of_ours(options):
    require_tool("log2asc", "can-utils")
    write("f.log")
    words = ["log2asc", *options, "-I", "f.log", "-O", "f.asc", "can0"]
    subprocess.run(words, check=True)  # noqa: S603 - a fixed command
    assert read("f.asc") == (FRAMES, LeftOut())


def test_asc2log_reads_ours():
    require_tool("asc2log", "can-utils")
    write("f.log")
    write("f.asc")
    words = ["asc2log", "-I", "f.asc"]
    made = subprocess.run(words, capture_output=True, text=True, check=True)  # noqa: S603
    lines = Path("f.log").read_text().splitlines()
    assert [line.split()[1:3] for line in made.stdout.splitlines()] == [
        line.split()[1:] for line in lines
    ]


def test_wireshark_reads_ours():
    require_tshark()
    write("f.log")
    fields = ("can.len", "canfd.flags.brs", "canfd.flags.esi", "data.data")
    shown = dissect("f.log", *fields, decode_as="can.subdissector,data")
    fd = [row for row, frame in zip(shown, FRAMES, strict=True) if frame.fd]
    assert [int(row[0]) for row in fd] == [len(f.data) for f in FRAMES if f.fd]
    assert [row[1] == "True" or row[1] == "1" for row in fd] == [
        f.fd & BRS != 0 for f in FRAMES if f.fd
    ]
    assert [row[3] for row in fd] == [f.data.hex() for f in FRAMES if f.fd]


VECTOR = """\
date Sam Sep 30 15:06:13.191 2017
base hex  timestamps absolute
internal events logged
Begin Triggerblock Sam Sep 30 15:06:13.191 2017
   0.000000 Start of measurement
   0.045522 CANFD   62 Rx         7d  BrakeSnData_4                    1 0 8  8 \
01 1b d6 d0 8a 1f d7 f6   104812  132   323000 a800f6c9 46500250 4b140250 20011736 2001040d
   0.045600 CANFD   62 Rx         7d  BrakeSnData_4                    1 0 8  8 01 1b d6 d0
   0.045610 CANFD   62 Rx         7d  BrakeSnData_4                    1 0 9  9 \
01 1b d6 d0 8a 1f d7 f6 00  104812  132   323000 a800f6c9 46500250 4b140250 20011736 2001040d
   0.045620 CANFD   62 Rx
   0.045630 62  181             Rx
  30.300981 CANFD   3 Tx     50005x                                0 1 5 0 \
140000 73 200050 7a60 46500250 460a0250 20011736 20010205
  30.400000 CANFD   3 Rx        181                                0 0 2  2 \
01 02   140000 73 200000 7a60 46500250 460a0250 20011736 20010205
End TriggerBlock
"""
"""Lines as CANoe writes them, the first and the remote one from python-can's tests; a frame cut,
one of a length that no DLC has, two lines cut, and a classical frame on a channel of CAN FD."""


def test_of_vectors_asc_what_is_no_frame_is_counted_and_the_rest_read():
    Path("v.asc").write_text(VECTOR)
    frames, left_out = read("v.asc")
    assert frames == [
        Frame(0x7D, bytes.fromhex("011bd6d08a1fd7f6"), fd=FDF | BRS),
        Frame(0x50005, is_remote=True, is_extended=True),
        Frame(0x181, b"\x01\x02"),
    ]
    assert left_out == LeftOut(damaged_lines=4, first_damaged=7)


TRC = """\
;$FILEVERSION=2.1
;$STARTTIME=43008.920986006946
;$COLUMNS=N,O,T,B,I,d,R,L,D
      1      1059.900 DT 1     0300 Rx -  7    00 00 00 00 04 00 00
      2      1283.231 FD 1     0400 Rx -  9    00 01 02 03 04 05 06 07 08 09 0A 0B
      3      1284.231 FB 1     0401 Rx -  8    00 01 02 03 04 05 06 07
      4      1285.231 FE 1 18FF0402 Rx -  1    AA
      5      1286.231 BI 1     0403 Rx -  2    AA BB
      6      1287.231 FB 1     0401 Rx -  9    00 01 02 03 04 05 06 07
"""
"""The types are those of the PEAK CAN TRC File Format: FB has BRS, FE has ESI, BI both; the last
line lacks four bytes."""


def test_a_trc_of_peak_has_the_bits_of_can_fd():
    Path("t.trc").write_text(TRC)
    frames, left_out = read("t.trc")
    assert [frame.fd for frame in frames] == [0, FDF, FDF | BRS, FDF | ESI, FDF | BRS | ESI]
    assert [len(frame.data) for frame in frames] == [7, 12, 8, 1, 2]
    assert left_out == LeftOut(damaged_lines=1, first_damaged=9)


def test_a_candump_log_has_flags_of_the_kernel_too_and_no_length_without_a_dlc():
    """Newer kernels set CANFD_FDF, so candump writes 5 where older ones have 1."""
    Path("c.log").write_text(
        "(0.000001) can0 123##5AA\n"
        f"(0.000002) can0 123##1{'00' * 9}\n"
        "(0.000003) can0 123##1R\n"
        f"(0.000004) can0 123#{'00' * 9}\n"
        "(0.000005) can0 123##2\n"
        "(0.000006) can0 123##10"
    )
    frames, left_out = read("c.log")
    assert frames == [Frame(0x123, b"\xaa", fd=FDF | BRS), Frame(0x123, fd=FDF | ESI)]
    assert (left_out.damaged_lines, left_out.first_damaged) == (3, 2)
    assert left_out.ending == "its last line has no line end, and is left out"
