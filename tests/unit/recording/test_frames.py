import re
import struct
import subprocess
import zlib
from datetime import UTC, datetime

import can
import pytest
from support.dissection import dissect, require_tool, require_tshark

from hil_bench.abilities.common.block_file import BUS_LOGS
from hil_bench.abilities.recording.frames import LeftOut, open_frame_file, read_frames
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import LoggedFrame

MILLISECOND = 1_000_000  # [ns]


def logged(can_id, data, milliseconds, *, is_received=True):
    return LoggedFrame(Frame(can_id, data), milliseconds * MILLISECOND, is_received)


def test_candump_log_is_written_as_candump_writes_it(tmp_path):
    path = tmp_path / "bus.log"
    with open_frame_file(path) as file:
        file.write_frames(
            [
                logged(0x201, b"\x07\x00\x00\x20", 1000),
                logged(0x181, b"\x0f\x00", 1001, is_received=False),
                LoggedFrame(Frame(0x12345678, b"\x01", is_extended=True), 1002 * MILLISECOND, True),
                LoggedFrame(Frame(0x701, is_remote=True), 1003 * MILLISECOND, True),
            ]
        )

    # candump -L of can-utils: (seconds) channel ID#DATA.
    assert path.read_text().splitlines() == [
        "(1.000000) can0 201#07000020",
        "(1.001000) can0 181#0F00",
        "(1.002000) can0 12345678#01",
        "(1.003000) can0 701#R",
    ]


def test_a_candump_log_says_a_direction_where_python_can_wrote_it(make_file):
    path = make_file("bus.log", "(1.0) can0 181#0F00 T\n(2.0) can0 201#07 R\n\n(3.0) can0 080#\n")
    assert [frame.is_received for frame in read_frames(path)] == [False, True, None]


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_frames_of_several_buses_come_back_on_their_own(tmp_path, suffix):
    path, left_out = tmp_path / f"bus{suffix}", LeftOut()
    sent = [LoggedFrame(Frame(0x701, b"\0", bus=bus), bus * MILLISECOND, True) for bus in (1, 0, 1)]
    with open_frame_file(path) as file:
        file.write_frames(sent)
    found = list(read_frames(path, left_out, buses=2))
    assert [logged.frame.bus for logged in found] == [1, 0, 1]
    assert left_out == LeftOut()


def test_channels_beyond_the_buses_are_left_out(make_file):
    path = make_file("bus.log", "(1.0) vcan1 701#00\n(2.0) can2 701#00\n(3.0) can0 701#00\n")
    found = list(read_frames(path, left_out := LeftOut(), buses=2))
    assert [(logged.frame.bus, logged.now) for logged in found] == [(1, 10**9), (0, 3 * 10**9)]
    assert dict(left_out.channels) == {"can2": 1}


def every_kind(path):
    with open_frame_file(path) as file:
        file.write_frames(
            [
                logged(0x000, b"\x01\x00", 1001),
                logged(0x080, b"", 1002),
                logged(0x181, b"\x0f\x00\x00\x20", 1003, is_received=False),
                LoggedFrame(Frame(0x182, bytes(8), bus=1), 1004 * MILLISECOND, False),
                LoggedFrame(Frame(0x704, is_remote=True), 1005 * MILLISECOND, True),
                LoggedFrame(Frame(0x12345678, b"\x01", is_extended=True), 1006 * MILLISECOND, True),
                logged(0x704, b"\x7f", 1_001_000, is_received=False),
            ]
        )


def test_wireshark_reads_a_candump_log(tmp_path):
    require_tshark()
    path = tmp_path / "bus.log"
    every_kind(path)
    rows = dissect(
        path,
        *("frame.time_epoch", "can.id", "can.flags.rtr", "can.flags.xtd", "can.len"),
        "_ws.malformed",
    )
    assert [(float(time), int(can_id), *rest) for time, can_id, *rest in rows] == [
        (1.001, 0x000, "0", "0", "2", ""),
        (1.002, 0x080, "0", "0", "0", ""),
        (1.003, 0x181, "0", "0", "4", ""),
        (1.004, 0x182, "0", "0", "8", ""),
        (1.005, 0x704, "1", "0", "0", ""),
        (1.006, 0x12345678, "0", "1", "1", ""),
        (1001.0, 0x704, "0", "0", "1", ""),
    ]


def test_can_utils_read_a_candump_log(tmp_path):
    require_tool("log2asc")
    path = tmp_path / "bus.log"
    every_kind(path)
    done = subprocess.run(  # noqa: S603 - can-utils' program
        ["log2asc", "-I", str(path), "can0", "can1"],  # noqa: S607
        capture_output=True,
        text=True,
        check=True,
    )
    found = [line.split() for line in done.stdout.splitlines() if re.match(r"\s+\d", line)]
    # Time since the first frame, which must not be in second 0 [s], number of the interface,
    # identifier, (Rx), kind, length, data.
    assert [(float(row[0]), *row[1:3], *row[4:]) for row in found] == [
        (0.0, "1", "0", "d", "2", "01", "00"),
        (0.001, "1", "80", "d", "0"),
        (0.002, "1", "181", "d", "4", "0F", "00", "00", "20"),
        (0.003, "2", "182", "d", "8", *["00"] * 8),
        (0.004, "1", "704", "r", "0"),
        (0.005, "1", "12345678x", "d", "1", "01"),
        (999.999, "1", "704", "d", "1", "7F"),
    ]


@pytest.mark.parametrize("suffix", [".asc", ".log"])
def test_a_full_disk_is_told_with_the_file(tmp_path, suffix):
    path = tmp_path / f"bus{suffix}"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as caught, open_frame_file(path) as file:
        file.write_frames([logged(0x201, b"\x07", 1)])

    assert caught.value.filename == str(path)


@pytest.mark.parametrize("suffix", BUS_LOGS)
def test_each_format_reads_back_on_the_same_time_base(tmp_path, suffix):
    path = tmp_path / f"bus{suffix}"
    # The first frame comes late: times count from the start, not from it.
    frames = [
        logged(0x181 + tick, bytes([tick]), 1500 + tick, is_received=bool(tick % 2))
        for tick in range(3)
    ]
    with open_frame_file(path) as file:
        file.write_frames(frames[:2])
        file.flush(durable=True)
        file.write_frames(frames[2:])

    if suffix == ".log":  # which says of none whether it was received
        frames = [frame._replace(is_received=None) for frame in frames]
    assert list(read_frames(path)) == frames
    with can.LogReader(path) as reader:
        found = [(m.arbitration_id, bytes(m.data), m.is_rx) for m in reader]
    # What a file does not say, python-can takes for received.
    sent = suffix == ".log"
    assert found == [(0x181, b"\x00", sent), (0x182, b"\x01", True), (0x183, b"\x02", sent)]


def test_an_unknown_suffix_is_refused_before_anything_is_written(tmp_path):
    for name, suffix in (("bus.pcap", ".pcap"), ("bus", ""), ("bus.log.gz", ".gz")):
        with pytest.raises(ConfigError) as caught:
            open_frame_file(tmp_path / name)
        assert str(caught.value) == (
            f'{tmp_path}/{name}: no format has the suffix "{suffix}"; '
            "give a file name that ends in one of .asc .blf .log"
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", BUS_LOGS)
def test_a_directory_that_is_not_there_is_refused_at_once(tmp_path, suffix):
    with pytest.raises(ConfigError) as caught:
        open_frame_file(tmp_path / "no" / f"bus{suffix}")

    assert str(caught.value) == (
        f"{tmp_path}/no/bus{suffix}: there is no folder {tmp_path}/no; make it first"
    )


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.log", b"no log at all\n"), ("x.blf", b"no log at all"), ("x.mf4", b"nor this")],
)
def test_a_file_that_is_no_log_says_so(make_file, name, content):
    path = make_file(name, content)
    with pytest.raises(ConfigError, match=rf"^{path}: "):
        list(read_frames(path))


def test_a_missing_log_says_so(tmp_path):
    with pytest.raises(ConfigError) as caught:
        list(read_frames(tmp_path / "no.log"))
    assert str(caught.value) == (
        f"{tmp_path}/no.log: cannot be read: No such file or directory; give a log of frames"
    )


@pytest.mark.parametrize(("suffix", "place"), [(".log", "can1 181#2A\n"), (".asc", " 2  181 ")])
def test_a_frame_of_another_bus_has_its_channel(tmp_path, suffix, place):
    path = tmp_path / f"bus{suffix}"
    with open_frame_file(path) as file:
        file.write_frames([LoggedFrame(Frame(0x181, b"\x2a", bus=1), MILLISECOND, True)])
    assert place in path.read_text()


def test_a_blf_object_that_claims_no_bytes_ends_the_log(tmp_path):
    # Found by fuzzing: an object header of 16 bytes and size 0 in the one container; python-can's
    # reader goes to "the next object", which is the same one, without end.
    path = tmp_path / "bus.blf"
    with open_frame_file(path) as file:
        file.write_frames([logged(0x181, b"\x2a", 1)])
    whole = path.read_bytes()
    header, claim = whole[:144], struct.pack("<4sHHLL", b"LOBJ", 16, 99, 0, 1)
    container = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + 16 + len(claim), 10)
    path.write_bytes(header + container + struct.pack("<H6xL4x", 0, len(claim)) + claim)
    with pytest.raises(ConfigError, match=r"bus\.blf: .*claims no bytes"):
        list(read_frames(path))


@pytest.mark.parametrize(
    ("packed", "wrong"),
    [
        (zlib.compress(bytes(65 << 20), 1), "unfolds to more than 64 MiB"),
        (zlib.compress(bytes(100))[:-1], "ends before its content does"),  # RFC 1950: a check sum
    ],
    ids=["huge", "cut"],
)
def test_a_blf_container_does_not_fill_the_memory_and_is_whole(tmp_path, packed, wrong):
    path = tmp_path / "bus.blf"
    open_frame_file(path).close()
    # 16 bytes of a header and 16 of a container, of Vector's type 10; packed by zlib, its method 2.
    head = struct.pack("<4sHHLLH14x", b"LOBJ", 16, 1, 32 + len(packed), 10, 2)
    path.write_bytes(path.read_bytes()[:144] + head + packed)
    with pytest.raises(ConfigError, match=rf"bus\.blf: .*{wrong}"):
        list(read_frames(path))


def test_an_asc_file_in_virtual_time_has_no_date_of_its_writing(tmp_path):
    dates = []
    for started in (None, datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)):
        with open_frame_file(tmp_path / "bus.asc", started) as file:
            file.write_frames([logged(0x181, b"\x2a", 1)])
        lines = (tmp_path / "bus.asc").read_text().splitlines()
        dates.append([line for line in lines if line.lower().startswith(("date", "begin"))])
    # As Vector writes dates, in local time.
    local = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC).astimezone().strftime("%a %b %d %H:%M:%S")
    assert dates[0] == [
        "date Thu Jan 01 00:00:00.0 1970",
        "Begin Triggerblock Thu Jan 01 00:00:00.0 1970",
    ]
    assert dates[1] == [f"date {local}.0 2026", f"Begin Triggerblock {local}.0 2026"]


def test_lines_that_are_no_frame_are_left_out_and_counted(tmp_path):
    path = tmp_path / "bus.log"
    lines = ["(1.0) can0 123#11", "(1.1) can0", "(1.2) can0 123#1", "(1.3) can0 00000124#22 R"]
    path.write_text("".join(f"{line}\n" for line in lines))
    frames = list(read_frames(path, left_out := LeftOut()))
    assert [(each.now, each.frame.can_id) for each in frames] == [
        (1_000_000_000, 0x123),
        (1_300_000_000, 0x124),
    ]
    assert (left_out.damaged_lines, left_out.first_damaged, left_out.ending) == (2, 2, "")


DROPPED = "DROPCOUNT: dropped {} CAN frame{} on 'can0' socket (total drops {})"
"""As candump of can-utils writes it into a log with -d."""


def test_frames_that_candump_has_lost_are_counted(tmp_path):
    path = tmp_path / "bus.log"
    lines = ["(1.0) can0 123#11", DROPPED.format(2, "s", 2), "(1.1) can0 123#12"]
    path.write_text("".join(f"{line}\n" for line in (*lines, DROPPED.format(1, "", 3))))
    assert len(list(read_frames(path, left_out := LeftOut()))) == 2
    assert (left_out.dropped, left_out.damaged_lines) == (3, 0)


RELATIVE = b"""date Sat Sep 30 10:06:13 PM 2017
base hex  timestamps relative
no internal events logged
0.1 1 100 Rx d 1 01
0.1 1 100 Rx d 1 02
"""


@pytest.mark.parametrize(
    ("head", "lines", "damaged"),
    [
        (1.1, [" 1) 1.0 Rx 0100 2 01 02", " 2) 2.0 Rx 0100 2 01", " 3) 3.0 Rx 0100 2 01 03"], 1),
        (1.1, [" 1) 1.0 Rx 0100 2 01 02", " 2) x Rx 0100 0", " 3) 3.0 Rx 0100 2 01 03"], 1),
        (1.1, [" 1) 1.0 Rx 0100 2 01 02", " 2) 1e999 Rx 0100 0", " 3) 3.0 Rx 0100 2 01 03"], 1),
        (
            2.1,
            ["1 1.0 DT 1 0100 Rx - 2 01 02", "2 2.0 DT 1 0100 Rx - 2 01", "3 3.0 ST 1 - Rx - 0"],
            1,
        ),
        (1.1, [], 0),
    ],
)
def test_a_line_of_a_trc_that_is_damaged_is_left_out_and_counted(make_file, head, lines, damaged):
    """python-can goes on without it, ends there, or takes two bytes for one."""
    columns = ";$COLUMNS=N,O,T,B,I,d,R,L,D\n" * (head > 2.0)
    text = f";$FILEVERSION={head}\n;$STARTTIME=43008.0\n{columns};---\n"
    path = make_file("bus.trc", text + "".join(f"{line}\n" for line in lines))
    left_out = LeftOut()
    found = [each.frame.data for each in read_frames(path, left_out)]
    assert found == [b"\x01\x02", b"\x01\x03"][: len(lines) - damaged - (head > 2.0)]
    assert (left_out.damaged_lines, left_out.ending) == (damaged, "")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        (
            "scope.trc",
            b"#9000000357WAVEDESC\x00\xf3\x9b" * 9 + b"\n a\n",
            'not begin with ";", as PEAK',
        ),
        ("scope.trc", b"\x00\xf3\x9b TEXT @ 2 @ 64\n", 'not begin with ";", as PEAK'),
        # As IXXAT's MiniMon writes it: python-can finds frames in its lines.
        (
            "minimon.trc",
            b'ASCII Trace\n"Time";"Identifier (hex)"\n 1 20.66 83 8 00 00 00 01 20 00 00 00\n',
            'not begin with ";", as PEAK',
        ),
        ("notes.asc", b"hello\nworld\n", 'not begin with "date" or'),
        (
            "bus.asc",
            RELATIVE,
            "its times are relative, each to the line before; export it with absolute ones",
        ),
    ],
)
def test_a_log_in_another_form_is_refused_in_a_line(make_file, name, content, reason):
    """LeCroy's oscilloscopes have .trc, too. Vector's relative times restart with each line."""
    with pytest.raises(ConfigError, match=reason) as caught:
        list(read_frames(make_file(name, content)))
    assert str(caught.value).isprintable()


def test_what_candump_shows_on_a_terminal_is_read(make_file):
    """The lines are as can-utils' candump prints them with -t a, and with -x, -a or -e, too."""
    path = make_file(
        "terminal.log",
        " (0000000001.249713)  vcan0  044   [3]  2A 36 6C\n"
        " (0000000001.249720)  vcan0  TX B E  12345678  [08]  01 02 03 04 05 06 07 08\n"
        " (0000000001.249721)  vcan0  RX - -  123   [4]  remote request\n"
        " (0000000001.349721)  vcan0  RX - -  0FF   [2]  2A 36   '*6'\n"
        " (0000000001.349722)  vcan0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n"
        "\tcontroller-problem{rx-error-warning}\n",
    )
    left_out = LeftOut()
    first, second, third, fourth = read_frames(path, left_out)
    assert (first.frame, first.is_received) == (Frame(0x044, b"*6l"), None)
    assert second.frame == Frame(
        0x12345678, bytes(range(1, 9)), is_extended=True, fd=FDF | BRS | ESI
    )
    assert (third.frame.is_remote, third.is_received) == (True, True)
    assert (fourth.frame.data, fourth.now - first.now) == (b"*6", 100_008_000)
    assert (left_out.error_frames, left_out.damaged_lines) == (1, 1)


TRC = [
    (
        ";##\n",
        "1) 1841 0001 8 EC EC EC EC EC EC EC EC",
        "2) 1842 0008 4 ERROR 00 19 08 08",
        "3) 1843 FFFFFFFF 4 00 00 00 04 -- -- -- -- BUSLIGHT",
    ),
    (
        ";$FILEVERSION=1.1\n;$STARTTIME=37704.5\n",
        "1) 1841 Rx 0001 8 EC EC EC EC EC EC EC EC",
        "2) 1842 Error 0008 4 00 19 08 08",
        "3) 1843 Warng FFFFFFFF 4 00 00 00 04 BUSLIGHT",
    ),
    (
        ";$FILEVERSION=1.2 \n;$STARTTIME=39878.6772258947; \n",
        "1) 1841.000 1 Rx 0001 8 EC EC EC EC EC EC EC EC",
        "2) 1842.000 1 Error 0008 4 00 19 08 08",
        "3) 1843.000 1 Warng FFFFFFFF 4 00 00 00 04 BUSLIGHT",
    ),
    (
        ";$FILEVERSION=1.3\n;$STARTTIME=40023.5\n",
        "1) 1841.000 1 Rx 0001 - 8 EC EC EC EC EC EC EC EC",
        "2) 1842.000 1 Error 0008 - 4 00 19 08 08",
        "3) 1843.000 1 Warng FFFFFFFF - 4 00 00 00 04 BUSLIGHT",
    ),
    (
        ";$FILEVERSION=2.0\n;$STARTTIME=42209.4\n;$COLUMNS=N,O,T,I,d,l,D\n",
        "1 1841.000 DT 0001 Rx 8 EC EC EC EC EC EC EC EC",
        "2 1842.000 ER Rx 08 00 19 08 08",
        "3 1843.000 ST Rx 00 00 00 04",
    ),
    (
        ";$FILEVERSION=2.1\n;$STARTTIME=41766.4\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        "1 1841.000 DT 1 0001 Rx - 8 EC EC EC EC EC EC EC EC",
        "2 1842.000 ER 1 - Rx - 5 08 00 19 08 08",
        "3 1843.000 ST 1 - Rx - 4 00 00 00 04",
    ),
]
"""Of each version: head, a frame, an error frame (of another kind than bit, form and stuff, seen by
the sender) and a state of the adapter, as PEAK's description of the format has them."""


@pytest.mark.parametrize(("head", "frame", "error", "state"), TRC)
def test_error_frames_and_states_of_a_trc_of_any_version(make_file, head, frame, error, state):
    events = "4 1844.000 EV 1 of the user\n5 1845.000 EC 1 - Rx - 2 02 02\n" * ("COLUMNS" in head)
    text = f"{head}{frame}\n{error}\n{error.replace('08 00 19', '04 01 19')}\n{state}\n{events}"
    path = make_file("bus.trc", text)
    left_out = LeftOut()
    first, second, third = read_frames(path, left_out, errors=True)
    assert first.frame == Frame(1, b"\xec" * 8)  # a byte as the name of a kind of line
    assert (second.frame.can_id, second.frame.data.hex()) == (0x2000_0008, "0000800000000000")
    assert second.now - first.now == pytest.approx(MILLISECOND, abs=200)  # of a date in float64
    is_v2 = "COLUMNS" in head  # the others have the type elsewhere, and the same one twice here
    assert third.frame.data.hex()[:6] == ("000004" if is_v2 else "000080")
    (words,) = left_out.words()
    name = "0x00000004" if is_v2 else "BUSLIGHT"
    assert words == f"lines on the adapter's state ({name}) left out: 1"
    without_errors = LeftOut()
    assert len(list(read_frames(path, without_errors))) == 1
    assert without_errors.error_frames == 2


def test_times_of_candump_that_each_count_from_the_line_before_are_refused(make_file):
    path = make_file("d.log", "".join(f" (000.{t:06})  can0  123   [0]\n" for t in (0, 90, 80)))
    with pytest.raises(ConfigError, match="line 3: its time goes back, as with candump -t d"):
        list(read_frames(path))


@pytest.mark.parametrize(
    ("line", "ending"),
    [
        (
            "  can0  123   [1]  11",
            "; what it shows on a terminal has a time with -t a; or record with -l",
        ),
        (" (1690000000.2)  can0  TX - -  18FEF100   [3]  11 22   '.\"'", "or record with -l"),
        (
            "[1] of 123",
            "not one line is one of candump -L; SavvyCAN converts the logs of many tools",
        ),
        ("***BUSMASTER Ver 2.0.0***\n\n14:8:19:5240 Rx 1 0x123 s 1 11", "of many tools"),
    ],
)
def test_a_file_without_a_line_of_candump_is_refused(make_file, line, ending):
    path = make_file("bus.log", f"{line}\n" * 3)
    with pytest.raises(ConfigError, match="not one line is one of candump -L") as caught:
        list(read_frames(path))
    assert str(caught.value).endswith(ending)
