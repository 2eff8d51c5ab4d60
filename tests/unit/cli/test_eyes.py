"""`hil-bench monitor`, `decode` and `record`: logs in, lines and files out."""

import json
import math
import socket
import struct

import can
import cantools
import numpy as np
import pytest
from support.scripted_bus import ScriptedBus
from support.sdo_frames import MS, answer, heard, request, upload
from support.tables import from_text

from hil_bench.abilities.eyes.explain.explain import Explainer, LiveFindings
from hil_bench.abilities.eyes.listener import Listener, dropped_by_kernel
from hil_bench.abilities.eyes.verbs import listening
from hil_bench.abilities.recording.frames import message_of, open_frame_file, read_frames
from hil_bench.abilities.recording.reading import given_units, read_recording
from hil_bench.canopen_device.frame import FDF, Frame
from hil_bench.cli import main
from hil_bench.outside.recording.channels import LoggedFrame

BENCH = """\
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressure_a = { profile = "pressure_404", node_id = 2, source = "P_A" }
"""

# 0x1000 of 0x4000 is 25 %; 50 bar; both by the EDS files of the profiles.
FRAMES = heard(
    Frame(0x701, b"\0"),
    Frame(0x702, b"\0"),
    Frame(0x182, struct.pack("<fB", 50.0, 0)),
    Frame(0x201, bytes.fromhex("07000010")),
    Frame(0x182, struct.pack("<fB", 50.0, 0)),
    *upload(2, 0x1001, 0, b"\0"),
    request(1, "2F 41 60 00 01"),
    answer(1, "80 41 60 00 02 00 01 06"),
    Frame(0x18EEFF00, b"\x01", is_extended=True),
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.toml").write_text(BENCH)
    for name in ("t.log", "t.asc", "t.blf"):
        with open_frame_file(tmp_path / name) as file:
            file.write_frames(FRAMES)
    return tmp_path


@pytest.fixture
def bus(monkeypatch):
    messages = [message_of(logged) for logged in FRAMES]
    for message in messages:
        message.timestamp += 1.7e9  # as a driver has it: the date
    messages.insert(3, can.Message(timestamp=1.7e9, is_error_frame=True))
    messages.insert(3, can.Message(timestamp=1.7e9, is_fd=True, data=bytes(12)))
    monkeypatch.setattr(listening, "open_can_bus", lambda *_: (ScriptedBus(messages), "can0"))


def lines(capsys):
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("name", ["t.log", "t.asc", "t.blf"])
@pytest.mark.usefixtures("folder")
def test_a_log_of_any_format_is_decoded(capsys, name):
    assert main(["decode", name, "bench.toml"]) == 0
    shown = lines(capsys)
    assert len(shown) == 8  # of ten frames, four are two transfers
    assert shown[2] == (
        "    0.002000  182  pressure_a    TPDO1      AI input process value 1 50 bar, AI status 1 0"
    )
    assert "Spool set-point 25 %" in shown[3]
    assert shown[7].startswith("    0.009000  18EEFF00")


@pytest.mark.parametrize(
    ("options", "count"),
    [
        (["--only", "pdo"], 3),
        (["--only", "pdo", "--changes"], 2),
        (["--hide", "pdo", "--hide", "heartbeat"], 3),
        (["--node", "pressure_a"], 4),
        (["--node", "1"], 3),
        (["--problems"], 1),
    ],
)
@pytest.mark.usefixtures("folder")
def test_filters_choose_lines(capsys, options, count):
    assert main(["decode", "t.log", "bench.toml", *options]) == 0
    assert len(lines(capsys)) == count


@pytest.mark.usefixtures("folder")
def test_json_has_a_line_a_sight(capsys):
    assert main(["decode", "t.log", "bench.toml", "--json", "--node", "2"]) == 0
    found = [json.loads(line) for line in lines(capsys)]
    value = found[1]["values"][0]
    assert (value["object"], value["value"], value["unit"]) == ("0x6130.01", 50.0, "bar")
    assert found[-1]["text"].startswith("upload 0x1001.00")


@pytest.mark.usefixtures("folder")
def test_colours_are_for_terminals(capsys):
    main(["decode", "t.log"])
    assert "\x1b" not in capsys.readouterr().out
    main(["decode", "t.log", "--colour", "always", "--problems"])
    assert capsys.readouterr().out.startswith("\x1b[31m")


def test_values_become_channels_in_si(folder, capsys):
    assert main(["decode", "t.log", "bench.toml", "-o", "d.mf4"]) == 0
    assert lines(capsys) == ["3 rows, 4 channels: d.mf4"]
    recording = read_recording(folder / "d.mf4")
    assert recording["pressure_a.ai_input_process_value_1"].tolist() == [50e5] * 3
    spool = recording["valve.spool_set_point"]
    assert np.isnan(spool[0])
    assert spool[1:].tolist() == [0.25, 0.25]
    assert len(list(read_frames(folder / "d.mf4"))) == len(FRAMES)
    assert given_units(recording)["valve.device_control_word"] == "1"  # a word of bits, no share
    assert "valve.spool_set_point" not in given_units(recording)


def write_pressures(path, *values):
    """Write a log of sensors: times [ms], pressures [bar], and the node-ID where it is not 2."""
    with open_frame_file(path) as file:
        for time, bar, *node in values:
            frame = Frame(0x180 + (node or [2])[0], struct.pack("<fB", bar, 0))
            file.write_frames([LoggedFrame(frame, round(time * 1e6), None)])


@pytest.mark.parametrize(
    ("options", "last"),
    [
        ((), {20: 120, 40: 160, 150: 600}),  # 100 ms at least; three times 40 and 150 ms
        (("--hold", "60"), {20: 80, 40: 100, 150: 210}),
    ],
)
def test_a_row_has_no_value_of_a_node_that_fell_silent(folder, options, last):
    """Rows come by node 3, each 10 ms; node 2 sends twice, `period` ms apart."""
    other = 'pressure_b = { profile = "pressure_404", node_id = 3, source = "P_A" }'
    (folder / "bench.toml").write_text(BENCH + other)
    for period, end in last.items():
        spoken = [(0, 50.0), (period, 51.0)]
        rows = [(time, 1.0, 3) for time in range(0, 1000, 10)]
        write_pressures(folder / "p.log", *sorted([*spoken, *rows]))
        assert main(["decode", "p.log", "bench.toml", "-o", "p.csv", *options]) == 0
        found = read_recording(folder / "p.csv")
        known = np.isfinite(found["pressure_a.ai_input_process_value_1"])
        assert round(found["time"][known][-1] * 1e3) == end
        assert np.isfinite(found["pressure_b.ai_input_process_value_1"])[1:].all()


def test_rows_at_even_ticks_hold_no_value_of_a_silent_node(folder, cli):
    """Each value stands in the first tick behind its frame, one of two in the next."""
    write_pressures(folder / "p.log", (0, 50.0), (0.2, 51.0), (0.4, 52.0), (9.5, 53.0), (10, 53.0))
    options = ["-o", "p.csv", "--tick", "1", "--hold", "3"]
    said = cli(["decode", "p.log", "bench.toml", *options])
    found = read_recording(folder / "p.csv")
    times = [round(time * 1e3, 6) for time in found["time"]]
    bars = [pressure / 1e5 for pressure in found["pressure_a.ai_input_process_value_1"]]
    # 52 bar came at 0.4 ms, stands at 2 ms, and is older than 3 ms at 4 ms
    assert dict(zip(times, bars, strict=True)) == {0: 50, 1: 51, 2: 52, 3: 52, 10: 53}
    assert "values stand up to 0.6 ms late" in said.err
    for path in ("p.csv", "p.mf4"):  # neither has the events of a bench
        cli(["decode", "p.log", "bench.toml", "-o", path, "--tick", "1"])
        requirement = "always pressure_a.ai_input_process_value_1 < 250 bar"
        (folder / "r.toml").write_text(f"[[expect]]\nid = 'R'\nthat = '{requirement}'\n")
        assert "does not hold the faults of its run: " in cli(f"judge r.toml {path}").err


@pytest.mark.parametrize(("shift", "first"), [(0.0, 5000), (1.7e9, 0)])
def test_a_log_keeps_its_time_but_for_the_date(folder, cli, shift, first):
    """As one that a trigger began at 5 s: what came then was not seen at 0 s."""
    write_pressures(folder / "p.log", (5e3 + 1e3 * shift, 50.0), (5002 + 1e3 * shift, 51.0))
    for tick in ([], ["--tick", "1"]):
        cli(["decode", "p.log", "bench.toml", "-o", "p.csv", *tick])
        assert round(1e3 * read_recording(folder / "p.csv")["time"][0]) == first


def test_a_log_whose_time_goes_back_is_refused(folder, cli):
    write_pressures(folder / "p.log", (0, 50.0), (30, 51.0), (19.5, 52.0))
    said = cli(["decode", "p.log", "bench.toml", "-o", "p.csv", "--tick", "1"], 2)
    assert "p.log: its time goes back from 0.030000 to 0.019500 s; give the log of one" in said.err


def test_more_values_than_ticks_are_refused(folder, capsys):
    """Ten values in 1 ms would wait ten ticks of 2 ms."""
    write_pressures(folder / "p.log", *((number * 0.1, number) for number in range(20)), (99, 0.0))
    assert main(["decode", "p.log", "bench.toml", "-o", "p.csv", "--tick", "2"]) == 2
    assert "has more values than ticks of 2 ms around" in capsys.readouterr().err


def test_a_dbc_reads_the_frames_as_we_do(folder):
    assert main(["decode", "t.log", "bench.toml", "--write-dbc", "bus.dbc"]) == 0
    database = cantools.database.load_file(folder / "bus.dbc")
    said = database.decode_message(0x182, FRAMES[2].frame.data)
    assert said["ai_input_process_value_1"] == 50.0
    assert database.decode_message(0x201, FRAMES[3].frame.data)["spool_set_point"] == 25.0
    assert database.get_message_by_name("pressure_a_TPDO1").senders == ["pressure_a"]


def test_a_log_that_is_cut_off_says_so(folder, cli):
    path = folder / "t.log"
    path.write_bytes(path.read_bytes()[:-5])
    shown = cli("decode t.log")
    assert "t.log: ends early: its last line has no line end, and is left out" in shown.err
    assert len(shown.out.splitlines()) == 7


def test_error_frames_are_shown_and_what_is_left_out_of_a_log_is_counted(folder, cli):
    error, fd = "(0.010000) can0 20000008#0000000000000000\n", "(0.011) can0 181##1AABB\n"
    bad = f"(0.012) can0 181##1{'00' * 9}\n"
    with (folder / "t.log").open("a") as file:
        file.write(error + fd + bad)
    shown, said = cli("decode t.log")
    assert "! error while receiving" in shown
    assert "CAN FD     BRS 2 bytes [AA BB]" in shown
    assert "line 13 is no frame of its format; left out" in said  # no DLC says 9 bytes


def test_the_name_of_another_channel_cannot_write_on_the_terminal(folder, capsys):
    with (folder / "t.log").open("a") as file:
        file.write("(0.011) ca\x9bn0 181#AABB\n")  # a C1 control: CSI in one character
    main(["explain", "t.log"])
    assert "left out (1 of ca\\x9bn0)" in capsys.readouterr().err


@from_text("arguments", "message")
def test_a_wrong_argument_is_one_line(folder, cli, arguments, message):
    (folder / "foreign.mf4").write_bytes(
        b"MDF     4.11    made up ".ljust(64, b"\0") + b"##HD" + bytes(99)
    )
    said = cli(["decode", *arguments.split()], 2).err
    assert said.count("\n") == 1
    assert message in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("decode", "has no frames to decode"),
        ("explain", "has no frames to explain"),
        ("replay", "has no frames to play"),
        ("shadow --log", ""),
    ],
)
@pytest.mark.parametrize("suffix", ["log", "asc"])
def test_a_log_without_frames_has_shown_nothing(make_file, cli, words, said, suffix):
    """As a bus on which no frame comes: docs/exit-codes.md has 6 for it."""
    path = make_file(f"empty.{suffix}", b"")
    found = cli([*words.split(), str(path)], 6)
    assert f"{path}: {said}" * bool(said) in found.err


@pytest.mark.usefixtures("folder", "bus")
def test_monitor_says_what_it_hears_until_ctrl_c(capsys, cli):
    shown = cli("monitor -i socketcan -c can0 bench.toml")
    assert main(["decode", "t.log", "bench.toml"]) == 0
    lines = shown.out.splitlines()
    errors = [line for line in lines if line.endswith("! error frame") or "CAN FD" in line]
    assert len(errors) == 2  # the log has none of either
    assert [line for line in lines if line not in errors] == capsys.readouterr().out.splitlines()
    # 9 ms from the first frame to the last; a vcan has no bit rate.
    assert shown.err.startswith("11 frames in 0.0 s on can0, 1 error frames, load")


@pytest.mark.usefixtures("folder")
def test_a_silent_bus_is_told_from_a_good_one(capsys, monkeypatch):
    monkeypatch.setattr(listening, "open_can_bus", lambda *_: (ScriptedBus([]), "can0"))
    assert main(["monitor", "-i", "socketcan", "-c", "can0"]) == 6
    assert capsys.readouterr().err.splitlines()[-1].startswith("0 frames in 0.0 s on can0")


@pytest.mark.usefixtures("bus")
def test_record_writes_frames_and_values(folder, capsys):
    assert main(["record", "r.mf4", "bench.toml", "-i", "socketcan", "-c", "can0"]) == 0
    shown = lines(capsys)
    assert shown[0] == "can0: recording 6 channels to r.mf4; Ctrl-C ends it"
    assert "3 rows, 12 frames: r.mf4" in shown[1]  # ten, an error frame and one of CAN FD
    assert shown[2:] == ["1 error frames"]
    assert read_recording(folder / "r.mf4")["valve.spool_set_point"][-1] == 0.25
    frames = [*read_frames(folder / "r.mf4")]
    assert [logged.frame for logged in frames if logged.frame.fd] == [
        Frame(0, bytes(12), is_extended=True, fd=FDF)
    ]
    times = [logged.now for logged in frames if not logged.frame.fd]
    assert times == pytest.approx([number * MS for number in range(10)], abs=1000)


@pytest.mark.usefixtures("folder", "bus")
def test_record_begins_at_its_trigger(capsys):
    trigger = ["--trigger", "valve.spool_set_point > 20 %", "--pre-trigger", "0.0005"]
    words = ["record", "r.mf4", "bench.toml", "-i", "socketcan", "-c", "can0", *trigger]
    assert main(words) == 0
    assert "2 rows, 7 frames: r.mf4" in lines(capsys)[1]  # from the RPDO on, the fourth of ten


@pytest.mark.parametrize(("file", "code"), [("r.csv", 6), ("r.mf4", 0)])
@pytest.mark.usefixtures("folder")
def test_record_says_that_no_node_has_sent_a_value(capsys, monkeypatch, file, code):
    messages = [message_of(logged) for logged in FRAMES[:2]]  # heartbeats
    monkeypatch.setattr(listening, "open_can_bus", lambda *_: (ScriptedBus(messages), "can0"))
    assert main(["record", file, "bench.toml", "-i", "socketcan", "-c", "can0"]) == code
    assert lines(capsys)[-1].startswith("no value came with 2 frames; nodes send PDOs once an NMT ")


@pytest.mark.usefixtures("folder", "bus")
def test_record_refuses_values_that_nobody_knows(capsys):
    assert main(["record", "r.csv", "-i", "socketcan", "-c", "can0"]) == 2
    assert "r.csv: no values to record, as no node is known" in capsys.readouterr().err


def test_times_never_run_back():
    stamps = [5.0, 4.0, 6.0]
    messages = [can.Message(timestamp=stamp, is_extended_id=False) for stamp in stamps]
    listener = Listener(ScriptedBus(messages), "can0")
    assert [listener.hear(0.0).now for _ in stamps] == [0, 0, 1_000_000_000]


def test_what_the_kernel_dropped_is_counted():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs,
    ):
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        ours.bind(("127.0.0.1", 0))
        assert dropped_by_kernel(ours) == 0
        for _ in range(100):
            theirs.sendto(bytes(500), ours.getsockname())
        ours.setblocking(False)
        read = 0
        try:
            while ours.recv(500):
                read += 1
        except BlockingIOError:
            pass
        assert dropped_by_kernel(ours) == 100 - read > 0


ASSUMED = (
    "hil-bench: nodes 1, 2, 3, 4 are read as those of the built-in bench; "
    "give bench.toml or --eds N=FILE for others\n"
)


@pytest.mark.usefixtures("folder", "bus")
@pytest.mark.parametrize(
    "words", [["decode", "t.log"], ["monitor", "-i", "socketcan", "-c", "can0"]], ids=lambda w: w[0]
)
def test_without_a_file_the_nodes_are_those_of_the_built_in_bench(words, cli):
    """As their help says; the built-in bench has node 1 `valve`."""
    said = cli([*words, "--node", "1"])
    assert said.out
    assert all("  valve" in line for line in said.out.splitlines())
    assert ASSUMED in said.err
    assert cli([*words, "--node", "1", "-q"]).err == ""


@pytest.mark.usefixtures("folder", "bus")
def test_nothing_that_is_written_or_explained_rests_on_nodes_that_nobody_named(capsys):
    assert main(["decode", "t.log", "-o", "v.csv"]) == 2
    assert main(["record", "v.csv", "-i", "socketcan", "-c", "can0"]) == 2
    main(["explain", "t.log"])
    said = capsys.readouterr()
    assert ASSUMED not in said.err
    assert "valve" not in said.out


@pytest.mark.usefixtures("folder", "bus")
def test_a_recording_is_named_by_o_as_well(capsys):
    for words in (["-o", "r.mf4", "bench.toml"], ["r.mf4", "bench.toml"]):
        assert main(["record", *words, "-i", "socketcan", "-c", "can0"]) == 0
        assert "recording 6 channels to r.mf4" in capsys.readouterr().out
    for words, wrong in (
        ([], "record: give the FILE to write, as in bus.mf4"),
        (["a.mf4", "bench.toml", "-o", "r.mf4"], "-o r.mf4: a.mf4 is a second recording; give one"),
    ):
        assert main(["record", *words, "-i", "socketcan", "-c", "can0"]) == 2
        assert capsys.readouterr().err == f"hil-bench: error: {wrong}\n"


def test_explain_counts_whom_it_has_heard_apart_from_those_spoken_to(folder, cli):
    """A master that looks for all 127 nodes, of which one answers."""
    asked = "".join(f"(0.{n:03}) can0 {0x600 + n:03X}#4000100000000000\n" for n in range(1, 128))
    (folder / "m.log").write_text(f"{asked}(0.500) can0 585#4300100092010200\n")
    assert ", 1 of 127 nodes heard, load" in cli("explain m.log").out
    assert json.loads(cli("explain m.log --json").out)["heard"] == ["node 5"]


def sdo(server, index, subindex, code=0x40, value=0):
    """A frame of an upload of node 5: the request, or the server's answer."""
    can_id = 0x585 if server else 0x605
    return f"{can_id:03X}#{code:02X}{index.to_bytes(2, 'little').hex()}{subindex:02X}" + (
        value.to_bytes(4, "little").hex()
    )


def write_sdo(folder, *rows):
    lines = [f"({at / 1e3:.6f}) can0 {frame}\n" for at, frame in rows]
    (folder / "s.log").write_text("".join(lines))


def test_explain_says_once_what_a_node_refuses_alike(folder, cli):
    """Four objects that are not there, one of them twice; another code is another fault."""
    rows = []
    for at, subindex in enumerate((1, 2, 3, 1, 4)):
        rows.append((100 * at, sdo(False, 0x2102, subindex)))
        rows.append((100 * at + 5, sdo(True, 0x2102, subindex, 0x80, 0x06020000)))
    rows += [(600, sdo(False, 0x2200, 0)), (605, sdo(True, 0x2200, 0, 0x80, 0x06010001))]
    write_sdo(folder, *rows)
    shown = cli("explain s.log --json", 1).out
    first, second = json.loads(shown)["findings"]
    assert first["text"] == (
        "node 5: upload 0x2102.01, 0x2102.02, 0x2102.03 and 1 more aborted, 0x06020000, object "
        "does not exist in the object dictionary, 5 times, first at 0.005 s"
    )
    assert "upload 0x2200.00 aborted, 0x06010001" in second["text"]
    told = cli("explain s.log", 1).out
    assert "\n                and 2 more\n" in told


def test_a_cause_does_not_come_again_when_its_node_says_what_it_is_called(folder):
    """On a bus that goes on: 0x1008 "Ab" is read after a refusal, and another one follows."""
    rows = [
        (0, "705#05"),
        (10, sdo(False, 0x2102, 1)),
        (15, sdo(True, 0x2102, 1, 0x80, 0x06020000)),
    ]
    rows += [(1000, sdo(False, 0x1008, 0)), (1005, sdo(True, 0x1008, 0, 0x4B, 0x6241))]
    rows += [(2000, sdo(False, 0x2102, 2)), (2005, sdo(True, 0x2102, 2, 0x80, 0x06020000))]
    write_sdo(folder, *rows, (3000, "705#05"))
    explainer = Explainer([], 1_000_000)
    live = LiveFindings(explainer)
    changes = []
    for logged in read_frames(folder / "s.log"):
        explainer.take(logged)
        changes += live.look(explainer.now)
    assert [(each.finding.node, each.is_gone) for each in changes] == [("node 5", False)]
    assert live.findings[0].node == 'node 5 "Ab"'


@pytest.mark.parametrize(("at", "seen"), [(160, "aborted by the client"), (2000, "not answered")])
def test_a_client_that_gives_up_waiting_is_one_request_without_an_answer(folder, cli, at, seen):
    """CiA 301, 7.2.4.3.17: 0504 0000h is that of its time-out, before or after we give it up."""
    rows = [(10, sdo(False, 0x2102, 1)), (at, sdo(False, 0x2102, 1, 0x80, 0x05040000))]
    write_sdo(folder, (0, "705#05"), *rows, (4000, "705#05"))
    (finding,) = json.loads(cli("explain s.log --json", 1).out)["findings"]
    assert finding["cause"] == "sdo_no_answer"
    assert f" is {seen}, " in finding["text"]
    assert "more" not in finding["text"]
    again = [(at + 3000, frame) for at, frame in rows]
    write_sdo(folder, (0, "705#05"), *rows, *again, (9000, "705#05"))
    (finding,) = json.loads(cli("explain s.log --json", 1).out)["findings"]
    assert finding["text"].endswith("; so are 1 more")


def test_explain_names_cause_node_clause_and_frames(folder, cli):
    shown = cli("explain t.log bench.toml", 1).out.splitlines()
    assert shown[0].startswith("10 frames in 0.009 s, 2 nodes, load ")
    assert shown[2] == "1. SDO transfer aborted  (CiA 301, 7.2.4.3.17)"
    assert shown[3] == (
        "   valve: download 0x6041.00 Device status word aborted, 0x06010002, attempt to write a "
        "read only object, first at 0.008 s"
    )
    assert shown[4].startswith("      0.008000  581  SDO  download 0x6041.00")
    (finding,) = json.loads(cli("explain t.log bench.toml --json", 1).out)["findings"]
    assert (finding["cause"], finding["node"]) == ("sdo_abort", "valve")
    with open_frame_file(folder / "sound.log") as file:
        file.write_frames(FRAMES[:5])
    assert cli("explain sound.log bench.toml").out.endswith("nothing wrong found\n")


FOREIGN = [Frame(0x625, bytes(6)), Frame(0x1F5, bytes(8)), Frame(0x710, bytes(8))]


def test_a_bus_that_is_no_canopen_is_said_to_be_none(folder, cli):
    with open_frame_file(folder / "car.log") as file:
        file.write_frames([LoggedFrame(each, n * 10**6, None) for n, each in enumerate(FOREIGN)])
    note = "this is no CANopen: 2 of 3 frames are not as CiA 301 has them, the first at 0.000 s: "
    shown = cli("explain car.log", 6).out.splitlines()
    assert shown[0].startswith("3 frames in 0.002 s, load ")
    assert shown[1].startswith(f"the log: {note}625 [00 00 00 00 00 00]")
    assert shown[2:] == [
        "not judged by CiA 301: load, silence and error frames are all that was looked at"
    ]
    content = json.loads(cli("explain car.log --json", 6).out)
    assert (content["languages"], content["is_judged"], content["nodes"]) == ([], False, [])
    said = cli("decode car.log").err
    assert note in said
    assert "are read as those of the built-in bench" not in said


@pytest.mark.parametrize(("aborts", "shown", "rest"), [(3, 3, []), (5, 3, ["and 2 more"])])
def test_explain_shows_the_first_frames_of_a_finding_and_counts_the_rest(
    folder, cli, aborts, shown, rest
):
    """SDO aborts of node 1 for a write to 0x6041 (CiA 301, 7.2.4.3.17)."""
    again = [request(1, "2B 41 60"), answer(1, "80 41 60 00 02 00 01 06")]
    with open_frame_file(folder / "many.log") as file:
        file.write_frames(heard(*aborts * again))
    lines = cli("explain many.log bench.toml", 1).out.splitlines()[4:]
    assert sum("  581  SDO  " in line for line in lines) == shown
    assert [line.strip() for line in lines if line.strip().startswith("and ")] == rest


@pytest.mark.usefixtures("bus")
@pytest.mark.parametrize(
    "words", [["decode", "t.log"], ["explain", "t.log"], ["monitor", "-i", "socketcan"]]
)
def test_quiet_says_nothing_but_errors(folder, capsys, words):
    path = folder / "t.log"
    path.write_bytes(path.read_bytes()[:-5])
    assert main([*words, "-q"]) in {0, 1}
    assert capsys.readouterr() == ("", "")


VENDOR_DBC = """\
VERSION ""
BU_: drive
BO_ 801 Motor: 3 drive
 SG_ speed : 0|8@1+ (0.5,-1) [0|0] "rpm" drive
"""


def test_a_dbc_of_a_user_is_read_and_never_written(folder, capsys):
    vendor = folder / "vendor.dbc"
    vendor.write_text(VENDOR_DBC)
    with can.TRCWriter("t.trc") as log:
        data = [7, 0, 0]  # 7 · 0.5 - 1 = 2.5 rpm
        log(can.Message(timestamp=1.7e9, arbitration_id=801, data=data, is_extended_id=False))

    assert main(["decode", "t.trc", "--dbc", "vendor.dbc"]) == 0
    (line,) = lines(capsys)
    assert line.split()[:3] == ["0.000000", "321", "drive"]
    assert line.endswith("speed 2.5 rpm")
    assert main(["decode", "t.log", "bench.toml", "--write-dbc", "vendor.dbc"]) == 2
    assert "vendor.dbc: is there already, and not written by hil-bench" in capsys.readouterr().err
    assert vendor.read_text() == VENDOR_DBC


IDLE = 'BO_ 9 Idle: 1 drive\n SG_ x : 0|8@1+ (1,0) [0|0] "" drive\n'
SPEED = 2.5 * 2.0 * math.pi / 60.0
"""7 · 0.5 - 1 = 2.5 rpm [rad/s]."""


def test_a_j1939_message_of_nobody_known_becomes_channels_by_a_dbc(folder, capsys):
    """PGN 65280 from address 5, behind its claim; a DBC marks 29-bit identifiers by bit 31."""
    identifier = 0x18FF0005
    vendor = VENDOR_DBC.replace("801", str(identifier | 1 << 31))
    (folder / "vendor.dbc").write_text(vendor)
    with can.TRCWriter("t.trc") as log:
        claim = [1, 0, 0, 0, 0, 0, 0, 128]
        log(can.Message(timestamp=1.7e9, arbitration_id=0x18EEFF05, data=claim))
        log(can.Message(timestamp=1.7e9 + 0.3, arbitration_id=identifier, data=[7, 0, 0]))
    assert main(["decode", "t.trc", "--dbc", "vendor.dbc", "-o", "d.csv"]) == 0
    assert lines(capsys) == ["1 rows, 1 channels: d.csv"]
    assert read_recording(folder / "d.csv")["Motor.speed"].tolist() == pytest.approx([SPEED])


def test_the_signals_of_a_dbc_become_channels(folder, capsys, monkeypatch):
    (folder / "vendor.dbc").write_text(VENDOR_DBC + IDLE + IDLE.replace("9", "10"))
    motor = can.Message(timestamp=1.7e9, arbitration_id=801, data=[7, 0, 0], is_extended_id=False)
    with can.TRCWriter("t.trc") as log:
        log(motor)
    assert main(["decode", "t.trc", "--dbc", "vendor.dbc", "-o", "d.csv"]) == 0
    assert lines(capsys) == ["1 rows, 1 channels: d.csv"]  # of the messages that came
    decoded = read_recording(folder / "d.csv")
    assert decoded["Motor.speed"].tolist() == pytest.approx([SPEED])

    for words in (["record", "r.csv"], ["monitor"]):
        monkeypatch.setattr(listening, "open_can_bus", lambda *_: (ScriptedBus([motor]), "can0"))
        assert main([*words, "--dbc", "vendor.dbc", "-i", "socketcan", "-c", "can0"]) == 0
    assert capsys.readouterr().out.endswith("speed 2.5 rpm\n")
    recorded = read_recording(folder / "r.csv")
    assert recorded["Motor.speed"].tolist() == pytest.approx([SPEED])
    assert np.isnan([recorded["Idle_9.x"][0], recorded["Idle_A.x"][0]]).all()  # of one name
    assert main(["decode", "t.trc", "--dbc", "vendor.dbc", "--write-dbc", "w.dbc"]) == 2
    assert "--write-dbc writes what is known without --dbc" in capsys.readouterr().err


CAR_DBC = (
    VENDOR_DBC.split("BO_ ", maxsplit=1)[0]
    + """
BO_ 385 Valves: 8 ECU
 SG_ a : 0|8@1+ (1,0) [0|0] "°C" X
BO_ 201 Engine: 6 ECU
 SG_ b : 0|8@1+ (1,0) [0|0] "" X
BO_ 1549 Door: 8 ECU
 SG_ c : 0|8@1+ (1,0) [0|0] "" X
BO_ 1808 Light: 8 ECU
 SG_ d : 0|8@1+ (1,0) [0|0] "" X
"""
)


J1939_DBC = """VERSION ""
BU_: ECU
BO_ 2364540158 EEC1: 8 ECU
 SG_ n : 24|16@1+ (0.125,0) [0|0] "rpm" X
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
BA_ "VFrameFormat" BO_ 2364540158 3;
"""


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_a_dbc_names_frames_that_have_identifiers_of_canopen(folder, capsys, encoding):
    """TPDO1 of node 1, an EMCY of six bytes, an SDO request, a heartbeat of eight bytes."""
    (folder / "car.dbc").write_text(CAR_DBC, encoding=encoding)
    ids = {0x181: "Valves a", 0x0C9: "Engine b", 0x60D: "Door c", 0x710: "Light d"}
    frames = [
        LoggedFrame(Frame(each, bytes([0x40 + n % 4] * (6 if n % 4 == 1 else 8))), n * 10**6, None)
        for n, each in enumerate([*ids] * 2)
    ]
    with open_frame_file(folder / "car.log") as file:
        file.write_frames(frames)
    assert main(["decode", "car.log", "--dbc", "car.dbc"]) == 0
    shown = [line.rstrip().split("  ") for line in capsys.readouterr().out.splitlines()]
    expected = ["a 64 °C", "b 65", "c 66", "d 67"]
    assert [line[-1].strip() for line in shown] == expected * 2
    assert main(["decode", "car.log", "--dbc", "car.dbc", "-o", "car.csv"]) == 0
    decoded = read_recording(folder / "car.csv")
    names = [words.replace(" ", ".") for words in ids.values()]
    assert [decoded[name][-1] for name in names] == [0x40, 0x41, 0x42, 0x43]
    (folder / "other.dbc").write_text(VENDOR_DBC)
    capsys.readouterr()
    assert main(["decode", "car.log", "--dbc", "other.dbc", "-o", "no.csv"]) == 2
    assert "and no message of other.dbc with signals; give the bench" in capsys.readouterr().err


BY_FORMAT = J1939_DBC[J1939_DBC.index("BA_DEF_") :]
BY_PROTOCOL = 'BA_DEF_ "ProtocolType" STRING ;\nBA_ "ProtocolType" "J1939";\n'
SPEEDS = {0: (0x1368, "n 621.0 rpm"), 3: (0x0C80, "n 400.0 rpm"), 5: (0xFFFF, "n not available")}
"""SPN 190 in the log by its sender: 0.125 rpm a bit, and all ones for no value (SAE J1939-71)."""


@pytest.mark.parametrize(
    ("kind", "sender", "known"),
    [
        (BY_FORMAT, 0xFE, [0, 3, 5]),
        (BY_PROTOCOL, 0xFE, [0, 3, 5]),
        (BY_FORMAT, 3, [3]),
        ("", 0xFE, []),  # without a word of J1939 the identifier is meant as it stands
    ],
)
def test_messages_of_j1939_are_found_by_group_and_by_the_sender_that_a_dbc_gives(
    folder, cli, monkeypatch, kind, sender, known
):
    """The file has EEC1 of priority 3, TSC1 to 0, EC1 of nine bytes, which come otherwise."""
    head, one, signal = J1939_DBC.partition("BO_")[0], J1939_DBC.splitlines()[2], "SG_ n : "
    assert one.startswith("BO_ 2364540158 EEC1: 8")
    text = f"{head}BO_ {0x8CF00400 | sender} EEC1: 8 ECU\n"
    text += f' {signal}24|16@1+ (0.125,0) [0|8031.875] "rpm" X\n'
    text += f'BO_ {0x8C0000FE} TSC1: 8 ECU\n {signal}0|8@1+ (1,0) [0|0] "" X\n'
    text += f'BO_ {0x98FEE3FE} EC1: 9 ECU\n {signal}64|8@1+ (1,0) [0|250] "" X\n'
    (folder / "j.dbc").write_text(text + kind)
    frames = [
        (0x18F00400 | address, b"\xff\xff\xff" + raw.to_bytes(2, "little") + b"\xff\xff\xff")
        for address, (raw, _) in SPEEDS.items()
    ]
    frames += [(0x0C001103, bytes([7] * 8)), (0x1CECFF00, bytes([32, 9, 0, 2, 255, 0xE3, 0xFE, 0]))]
    frames += [(0x1CEBFF00, bytes([1, *range(7)])), (0x1CEBFF00, bytes([2, 7, 9, *[255] * 5]))]
    logged = [
        LoggedFrame(Frame(can_id, data, is_extended=True), n * 50_000_000, None)
        for n, (can_id, data) in enumerate(frames)
    ]
    with open_frame_file(folder / "j.log") as file:
        file.write_frames(logged)
    shown = cli("decode j.log --dbc j.dbc")
    values = [line[line.index(" n ") + 1 :] for line in shown.out.splitlines() if " n " in line]
    if not kind:
        assert values == []
        assert 'give it BA_ "ProtocolType" "J1939";' in shown.err
        return
    assert values == [*(SPEEDS[each][1] for each in known), "n 7", "n 9"]
    unknown = "PGN 61444 comes from address 0, and the DBC file has it of 3 alone"
    assert (unknown in shown.err) == (known == [3])
    cli("decode j.log --dbc j.dbc -o j.csv")
    decoded = read_recording(folder / "j.csv")
    names = ["EEC1.n"] if known == [3] else [f"EEC1_0{each}.n" for each in known]
    assert decoded.dtype.names == ("time", *names, "TSC1.n", "EC1.n")
    held = [decoded[name][~np.isnan(decoded[name])][-1:] for name in decoded.dtype.names[1:]]
    speeds = {0: 621.0 * math.pi / 30.0, 3: 400.0 * math.pi / 30.0}
    expected = [*(speeds[each] for each in known if each in speeds), 7.0, 9.0]
    assert np.concatenate(held) == pytest.approx(expected)
    bus = [can.Message(arbitration_id=can_id, data=data) for can_id, data in frames]
    monkeypatch.setattr(listening, "open_can_bus", lambda *_: (ScriptedBus(bus), "can0"))
    said = cli("record r.csv --dbc j.dbc -i socketcan -c can0").out
    assert ("2 messages of J1939 from a second sender" in said) == (known != [3])
    assert read_recording(folder / "r.csv")["EEC1.n"][-1] == pytest.approx(speeds[known[0]])


@pytest.mark.usefixtures("folder")
def test_a_dbc_of_ours_is_written_again():
    arguments = ["decode", "t.log", "bench.toml", "--write-dbc", "bus.dbc"]
    assert [main(arguments), main(arguments)] == [0, 0]


@pytest.mark.usefixtures("folder", "bus")
def test_monitor_explains_what_it_hears_as_explain_does(capsys, cli):
    """The bus has the frames of t.log and an error frame."""
    said = cli("monitor --explain -i socketcan -c can0 bench.toml", 1)
    main(["explain", "t.log", "bench.toml"])
    of_log = capsys.readouterr().out.splitlines()[3:]
    assert said.out.splitlines()[-len(of_log) :] == of_log
    assert "1. error frames" in said.out
    assert said.err == "11 frames on can0, 1 error frames\n"


def test_what_candump_has_lost_is_said_beside_a_verdict(folder, capsys):
    with (folder / "t.log").open("a") as log:
        log.write("DROPCOUNT: dropped 7 CAN frames on 'can0' socket (total drops 7)\n")
    main(["explain", "t.log", "bench.toml", "--json"])
    said = capsys.readouterr()
    (note,) = json.loads(said.out)["notes"]
    assert note.startswith("7 frames were lost by its recorder; what is missing may be theirs")
    assert "lost" not in said.err
    main(["decode", "t.log", "bench.toml"])
    assert "7 frames were lost by candump, says the log" in capsys.readouterr().err


def test_explain_judges_one_channel_and_says_so(tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    lines = [f"({time / 10:.6f}) can{time % 2} 70{1 + time % 2}#05\n" for time in range(40)]
    for at in (7, 41):  # a warning of the other channel's adapter, among the frames and behind them
        lines.insert(at, f"({at / 10:.6f}) can1 20000004#0004000000000000\n")
    (tmp_path / "two.log").write_text("".join(lines))
    said = cli("explain two.log")
    assert said.out.startswith("20 frames in 3.800 s, 1 nodes")
    assert "nothing wrong found" in said.out
    assert "frames of other channels left out (22 of can1)" in said.err


def test_explain_says_that_the_clock_was_set_back(tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    times = [*range(100, 200), *range(100)]
    lines = [f"({time / 10:.6f}) can0 701#05\n" for time in times]
    (tmp_path / "back.log").write_text("".join(lines))
    assert "the log: the clock goes back at 9.900 s" in cli("explain back.log").out


def test_nothing_wrong_on_j1939_says_what_was_not_judged(make_file, cli):
    """A charger's demand (BCL of GB/T 27930) has PGN 4096, which SAE has not assigned."""
    claim = "(0.000000) can0 18EEFF56#0102030405060700\n"
    charging = "".join(f"({k / 20:.6f}) can0 181056F4#A00F0A00FF\n" for k in range(1, 41))
    found = cli(["explain", str(make_file("charger.log", claim + charging))]).out.splitlines()
    assert found[-2] == "nothing wrong found"
    assert found[-1] == (
        "not judged: what the messages of J1939 say, but for trouble codes; 40 of 41 have a "
        "parameter group that is not known here, the first 4096"
    )


def test_an_instant_is_no_sound_bus(make_file, cli):
    beat = "(1.{}00000) can0 701#05\n"
    one, two = (make_file(f"{n}.log", "".join(map(beat.format, range(n)))) for n in (1, 2))
    found = cli(["explain", str(one)], 6).out
    assert "nothing wrong found, but an instant shows no period" in found
    assert cli(["explain", str(two)]).out.endswith("nothing wrong found\n")


TWO_BUSES = """\
[buses.sensors]
channel = "vcan1"
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressure_a = { profile = "pressure_404", node_id = 1, source = "P_A", bus = "sensors" }
"""


def test_the_channels_of_a_log_are_the_buses_of_its_bench(make_file, cli):
    log = make_file("two.log", "(0.0) can1 701#00\n(0.0) can0 701#00\n(0.1) can1 181#0000000000\n")
    bench = make_file("two.toml", TWO_BUSES)
    explained = cli(["explain", str(log), str(bench)]).out
    assert explained.startswith("3 frames in 0.100 s, 2 nodes, ")
    assert explained.endswith("\nnothing wrong found\n")
    lines = cli(["decode", str(log), str(bench)]).out.splitlines()
    assert [line.split()[1:5] for line in lines] == [
        ["can1", "701", "pressure_a", "boot-up"],
        ["can0", "701", "valve", "boot-up"],
        ["can1", "181", "pressure_a", "TPDO1"],
    ]


def test_of_two_channels_a_bench_of_one_bus_reads_one_and_says_so(make_file, cli):
    log = make_file("two.log", "(0.0) can1 701#00\n(0.0) can0 702#00\n")
    shown = cli(["decode", str(log), str(make_file("one.toml", BENCH))])
    assert shown.out.split()[1:] == ["701", "valve", "boot-up"]
    assert "frames of other channels left out (1 of can0)" in shown.err
