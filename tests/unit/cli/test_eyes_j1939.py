"""Signals of J1939 devices as channels: `hil-bench decode -o` of logs and `record` of a bus."""

import math
from pathlib import Path

import cantools
import numpy as np
import pytest
from support.scripted_bus import ScriptedBus
from support.sdo_frames import MS

from hil_bench import load_config
from hil_bench.abilities.eyes.verbs import listening
from hil_bench.abilities.recording.frames import message_of, open_frame_file, read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.outside.recording.channels import LoggedFrame

BENCH = """\
[plant.axis1]

[j1939.valve]
kind = "auxiliary_valve"
address = 128
[j1939.stick]
address = 19
identity = 7
[j1939.stick.signals]
x = { pgn = 0xFDD6, start_bit = 6, length = 10, resolution = 0.1, unit = "%", rate_ms = 20 }
p = { pgn = 0xFF10, start_bit = 64, length = 16, resolution = 0.5, unit = "bar", rate_ms = 50 }
unheard = { pgn = 0xFF20, start_bit = 0, length = 8 }
"""
DRIVE = """\
[plant.axis1]

[j1939.drive]
address = 40
[j1939.drive.signals.command]
pgn = 0xEF00
start_bit = 0
length = 8
offset = -125
unit = "%"
sink = "axis1.spool_setpoint"
"""

# 65072: 125 x 0.4 % = 50 %, byte 3: 1 extends, 2 retracts, 7 is reserved. 65040: flow of the
# extend port 100 - 125 = -25 %. 64982: 400 from bit 6 are 40 %, 0x3FE of 10 bits is the error
# indicator. 65296 has ten bytes by BAM: 200 x 0.5 bar from byte 9 on.
FRAMES = (
    (0x0CFE3027, "7D FF F1 FF FF FF FF FF"),
    (0x0CFE1080, "64 96 F2 1F C0 FF FF FF"),
    (0x18FDD613, "00 64 FF FF FF FF FF FF"),
    (0x18ECFF13, "20 0A 00 02 FF 10 FF 00"),
    (0x18EBFF13, "01 FF FF FF FF FF FF FF"),
    (0x18EBFF13, "02 FF C8 00 FF FF FF FF"),
    (0x0CFE3027, "7D FF F2 FF FF FF FF FF"),
    (0x18FDD613, "80 FF FF FF FF FF FF FF"),
    (0x0CFE3027, "7D FF F7 FF FF FF FF FF"),
    (0x18FDD614, "00 32 FF FF FF FF FF FF"),  # of another device
)


def logged(frames=FRAMES):
    return [
        LoggedFrame(Frame(can_id, bytes.fromhex(data), is_extended=True), number * MS, True)
        for number, (can_id, data) in enumerate(frames)
    ]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.toml").write_text(BENCH)
    (tmp_path / "drive.toml").write_text(DRIVE)
    return tmp_path


def write_log(frames=FRAMES):
    with open_frame_file(Path("t.log")) as file:
        file.write_frames(logged(frames))


def column(recording, name):
    """Return the values of a channel, None for NaN."""
    return [None if math.isnan(value) else value for value in recording[name].tolist()]


SET_POINTS = [0.5, 0.5, 0.5, 0.5, -0.5, -0.5, None]
FLOWS = [None, -0.25, -0.25, -0.25, -0.25, -0.25, -0.25]
LEVER = [None, None, 0.4, 0.4, 0.4, None, None]
PRESSURES = [None, None, None, 100e5, 100e5, 100e5, 100e5]


@pytest.mark.parametrize("suffix", ["mf4", "csv"])
def test_signals_of_a_log_become_channels_in_si(cli, suffix):
    write_log()
    path = f"d.{suffix}"
    assert cli(["decode", "t.log", "bench.toml", "-o", path]).out == f"7 rows, 4 channels: {path}\n"
    recording = read_recording(Path(path))
    times = [0, 1, 2, 5, 6, 7, 8]  # of a long message its last frame
    assert recording["time"].tolist() == pytest.approx([ms * 1e-3 for ms in times])
    assert column(recording, "valve.spool_setpoint") == SET_POINTS
    assert column(recording, "valve.flow") == pytest.approx(FLOWS)
    assert column(recording, "stick.x") == pytest.approx(LEVER)
    assert column(recording, "stick.p") == PRESSURES


def test_a_device_is_followed_to_another_address():
    """Its NAME is the one of the bench: identity 7, arbitrary address."""
    config = load_config(Path("bench.toml"))
    name = next(int(ecu.identity) for ecu in config.ecus if ecu.name == "stick")
    claim = (0x18EEFF14, name.to_bytes(8, "little").hex())
    write_log([claim, (0x18FDD614, "00 32 FF FF FF FF FF FF")])
    assert main(["decode", "t.log", "bench.toml", "-o", "d.mf4"]) == 0
    assert column(read_recording(Path("d.mf4")), "stick.x") == [0.2]


def test_a_command_is_of_the_device_that_it_is_meant_for():
    # Proprietary A to address 40, to 41, to all: 175 - 125 = 50 %, and so on.
    write_log([(0x18EF2827, "AF"), (0x18EF2927, "00"), (0x18EFFF27, "4B")])
    assert main(["decode", "t.log", "drive.toml", "-o", "d.mf4"]) == 0
    assert column(read_recording(Path("d.mf4")), "drive.command") == pytest.approx([0.5, -0.5])


def test_a_log_without_their_messages_has_no_channels(cli):
    write_log([(0x18FF0013, "00")])
    assert "no J1939 signal of a known device" in cli("decode t.log bench.toml -o d.mf4", 2).err
    assert not Path("d.mf4").exists()


def test_a_dbc_reads_the_frames_as_we_do(capsys):
    write_log()
    assert main(["decode", "t.log", "bench.toml", "--write-dbc", "bus.dbc"]) == 0
    assert capsys.readouterr().out == "2 messages: bus.dbc\n"  # of p, the message is too long
    database = cantools.database.load_file("bus.dbc")
    message = database.get_message_by_name("stick_PGN_64982")
    # The lever has no priority of its own: 6, the usual one of J1939, and address 19.
    assert (message.frame_id, message.is_extended_frame) == (0x18FDD613, True)
    assert message.senders == ["stick"]
    assert message.decode(bytes.fromhex("0064FFFFFFFFFFFF")) == {"x": 40.0}
    (lever,) = message.signals
    # 10 bits: the highest valid raw value is 0x3EB, the rest are indicators (J1939-71).
    assert (lever.minimum, lever.maximum, lever.unit) == (0.0, 100.3, "%")


@pytest.fixture
def bus(monkeypatch):
    monkeypatch.setattr(
        listening, "open_can_bus", lambda *_: (ScriptedBus(map(message_of, logged())), "can0")
    )


@pytest.mark.usefixtures("bus")
def test_record_writes_signals_of_a_bus(cli):
    words = ["record", "r.mf4", "bench.toml", "-i", "socketcan", "-c", "can0"]
    shown = cli(words).out.splitlines()
    assert shown[0] == "can0: recording 5 channels to r.mf4; Ctrl-C ends it"
    assert "7 rows, 10 frames: r.mf4" in shown[1]
    recording = read_recording(Path("r.mf4"))
    assert column(recording, "valve.spool_setpoint") == SET_POINTS
    assert column(recording, "stick.p") == PRESSURES
    assert np.isnan(recording["stick.unheard"]).all()
    assert len(list(read_frames(Path("r.mf4")))) == len(FRAMES)


@pytest.mark.usefixtures("bus")
def test_record_begins_where_a_signal_says(capsys):
    trigger = ["--trigger", "stick.p > 90 bar", "--pre-trigger", "0.0005"]
    assert main(["record", "r.mf4", "bench.toml", "-i", "socketcan", "-c", "can0", *trigger]) == 0
    assert "4 rows, 5 frames: r.mf4" in capsys.readouterr().out  # from the last packet on
