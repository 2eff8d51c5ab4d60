"""Frames of CAN FD before the eyes: shown as what they are, and no reason to accuse anybody."""

import math
import struct
from pathlib import Path

import can
import cantools
import pytest
from support.sdo_frames import MS
from support.sound_logs import SOUND

from hil_bench.abilities.eyes.bus_state import FIRST_FD, BusState
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.recording.frames import open_frame_file, read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.cli import main
from hil_bench.frame import bits_of
from hil_bench.outside.recording.channels import LoggedFrame

BITRATE = 1_000_000
FD_DBC = """\
VERSION ""
BU_: pump
BO_ 291 State: 64 pump
 SG_ pressure : 480|16@1+ (0.1,0) [0|6553.5] "bar" pump
BO_ 801 Motor: 3 pump
 SG_ speed : 0|8@1+ (0.5,-1) [0|0] "rpm" pump
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG","StandardCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 291 4;
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def mixed_with_fd(frames):
    """Put a frame of CAN FD behind each, with its identifier and other data, half a step later."""
    for number, logged in enumerate(frames):
        yield logged
        frame = logged.frame
        fd = Frame(frame.can_id, bytes((number % 251,)) * 64, is_extended=frame.is_extended)
        if not frame.is_extended and frame.can_id < 1 << 29:
            yield LoggedFrame(fd._replace(fd=FDF | BRS), logged.now + 1000, None)


@pytest.mark.parametrize("name", ["changes_while_it_runs", "every_object_read"])
def test_nothing_is_found_in_a_sound_log_beside_can_fd(name):
    """NMT, EMCY, heartbeats and PDOs by their identifiers, were they classical frames."""
    frames, known = SOUND[name]()
    found = explain(mixed_with_fd(frames), known, 8 * BITRATE, speedup=8.0)
    assert found.findings == ()
    assert set(found.nodes) <= {node.name for node in known}


def test_nobody_knows_how_many_send_can_fd_so_its_end_alone_is_no_silent_bus():
    frames = [Frame(0x300 + n % 3, bytes(64), fd=FDF) for n in range(90)]
    logged = [LoggedFrame(frame, n * 10 * MS, None) for n, frame in enumerate(frames)]
    late = [each._replace(now=each.now + 3000 * MS) for each in logged]
    assert explain([*logged, *late], (), BITRATE).findings == ()


def test_frames_of_can_fd_with_the_identifiers_of_heartbeats_hide_no_silence():
    """Heartbeats of two nodes each 100 ms, and others at odd times between; then 2 s of nothing."""
    logged = []
    for number in range(60):
        for node_id in (1, 2):
            now = (100 * number + node_id) * MS
            logged.append(LoggedFrame(Frame(0x700 + node_id, b"\x05"), now, None))
            fd = Frame(0x700 + node_id, bytes(12), fd=FDF)
            logged.append(LoggedFrame(fd, now + (5 + 37 * number % 60) * MS, None))
    logged.sort(key=lambda each: each.now)
    logged.append(LoggedFrame(Frame(0x701, b"\x05"), logged[-1].now + 2000 * MS, None))
    (finding, *_) = explain(logged, (), BITRATE).findings
    assert finding.cause is Cause.BUS_SILENT


@pytest.mark.parametrize(
    ("fd", "is_excused"), [(0, True), (FDF, False)], ids=["NMT", "its identifier in CAN FD"]
)
def test_nodes_that_were_stopped_leave_no_silent_bus(fd, is_excused):
    """PDOs of two nodes each 100 ms; NMT stops all, and the bus is quiet for 2 s."""
    logged = [
        LoggedFrame(Frame(0x180 + node_id, b"\0"), (100 * number + node_id) * MS, None)
        for number in range(60)
        for node_id in (1, 2)
    ]
    logged.append(LoggedFrame(Frame(0x000, b"\x02\0", fd=fd), logged[-1].now + MS, None))
    logged.append(LoggedFrame(Frame(0x181, b"\0"), logged[-1].now + 2000 * MS, None))
    causes = {finding.cause for finding in explain(logged, (), BITRATE).findings}
    assert (Cause.BUS_SILENT not in causes) == is_excused


def test_the_load_counts_the_data_at_their_own_bit_rate():
    """A frame of 64 bytes each millisecond: too much at 500 kbit/s, little with 8 Mbit/s."""
    frame = Frame(0x300, bytes(64), fd=FDF | BRS)
    logged = [LoggedFrame(frame, number * MS, None) for number in range(1000)]
    slow = explain(logged, (), 500_000)
    assert slow.load == pytest.approx(bits_of(frame) / 500, rel=2e-3)
    assert [finding.cause for finding in slow.findings] == [Cause.BUS_LOAD]
    fast = explain(logged, (), 500_000, speedup=16.0)
    assert fast.load == pytest.approx(bits_of(frame, 16.0) / 500, rel=2e-3)
    assert fast.findings == ()


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (Frame(0x181, b"\xab\xcd", fd=FDF | BRS), "BRS 2 bytes [AB CD]"),
        (Frame(0x000, bytes((1, 0)), fd=FDF | ESI), "ESI 2 bytes [01 00]"),
        (Frame(0x18FEF100, b"\x01", is_extended=True, fd=FDF), "1 bytes [01]"),
    ],
)
def test_a_frame_of_can_fd_is_never_read_as_canopen_or_j1939(frame, text):
    decoder = Decoder()
    (sight,) = decoder.take(LoggedFrame(frame, 0, None))
    assert (sight.name, sight.text, sight.node, sight.problem) == ("CAN FD", text, "", "")
    assert not decoder.nodes


def test_the_state_of_a_bus_keeps_both_kinds_apart():
    state = BusState(Decoder(), BITRATE)
    for number in range(4):
        for frame in (Frame(0x701, b"\x05"), Frame(0x701, bytes(12), fd=FDF)):
            state.take(LoggedFrame(frame, number * MS, None))
    classical, fd = state.streams[0x701], state.streams[FIRST_FD + 0x701]
    assert (classical.name, classical.count, fd.name, fd.count) == ("heartbeat", 4, "CAN FD", 4)
    assert state.heartbeat_missing(1) == 0.0


def written_log():
    """A log with 305.5 bar in the last bytes of a frame of 64, and 2.5 rpm in a classical one."""
    data = bytes(60) + struct.pack("<H", 3055) + bytes(2)
    frames = [Frame(291, data, fd=FDF | BRS), Frame(801, bytes((7, 0, 0)))]
    Path("v.dbc").write_text(FD_DBC)
    with can.BLFWriter("f.blf") as log:
        for number, frame in enumerate(frames):
            log(
                can.Message(
                    timestamp=1.7e9 + number,
                    arbitration_id=frame.can_id,
                    is_extended_id=False,
                    is_fd=frame.fd != 0,
                    bitrate_switch=frame.fd != 0,
                    data=frame.data,
                )
            )
    (message,) = [each for each in cantools.database.load_file("v.dbc").messages if each.is_fd]
    assert message.decode(data) == {"pressure": 305.5}


def test_a_message_of_64_bytes_of_a_dbc_is_read_in_words_and_as_channels(cli):
    written_log()
    first, second = cli("decode f.blf --dbc v.dbc --raw").out.splitlines()
    assert first.split()[:3] == ["0.000000", "123", "pump"]
    assert first.endswith("pressure 305.5 bar")
    assert second.endswith("speed 2.5 rpm")
    assert main(["decode", "f.blf", "--dbc", "v.dbc", "-o", "d.mf4"]) == 0
    recording = read_recording(Path("d.mf4"))
    pressure, grown_old = recording["State.pressure"]  # [Pa]; the second row is a second later
    assert pressure == pytest.approx(305.5e5)
    assert math.isnan(grown_old)
    assert [logged.frame.fd for logged in read_frames(Path("d.mf4"))] == [FDF | BRS, 0]


def test_json_says_which_frames_are_of_can_fd(cli):
    with open_frame_file(Path("f.log")) as file:
        file.write_frames(
            [
                LoggedFrame(Frame(0x123, bytes(12), fd=FDF | BRS), 0, True),
                LoggedFrame(Frame(0x123, bytes(8)), MS, True),
            ]
        )
    first, second = cli("decode f.log --json").out.splitlines()
    assert '"is_fd": true, "has_brs": true, "has_esi": false' in first
    assert '"is_fd": false, "has_brs": false, "has_esi": false' in second
