"""`--record` of run and demo."""

import errno
import shlex

import pytest
from support.tables import from_text

from hil_bench.abilities.common import block_file
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.transports.transport import TransportCounters

RUN = ["run", "-i", "virtual", "-c", "test_recording", "--duration", "0.1"]


@pytest.fixture
def _virtual_time(monkeypatch):
    monkeypatch.setattr("hil_bench.cli.paced_run.MonotonicClock", VirtualClock)


@pytest.mark.usefixtures("_virtual_time")
def test_a_run_is_recorded_from_its_first_tick(tmp_path, cli):
    path = tmp_path / "run.mf4"
    assert f"recorded  100 rows, 4 frames: {path}\n" in cli([*RUN, "--record", str(path)]).out
    signals = read_recording(path)
    assert signals["time"] == pytest.approx([tick * 1e-3 for tick in range(100)])
    # At rest at 100 bar supply the balanced chambers lie at half of it, P_A A_A = P_B A_B.
    assert signals["axis1.P_A"] == pytest.approx(100e5 / 2 * 2 * 47 / (50 + 47))
    boot_ups = [(logged.frame.can_id, logged.is_received) for logged in read_frames(path)]
    assert boot_ups == [(can_id, False) for can_id in (0x701, 0x702, 0x703, 0x704)]


@pytest.mark.usefixtures("_virtual_time")
@pytest.mark.parametrize(("words", "received"), [([], []), (["--whole-bus"], [0x7FF])])
def test_only_the_whole_bus_has_frames_that_are_for_nobody_here(
    tmp_path, monkeypatch, words, received
):
    monkeypatch.setattr("hil_bench.cli.run_setup.open_transport", lambda *_: FilteredBus())
    path = tmp_path / "run.mf4"
    assert main([*RUN, "--record", str(path), *words]) == 0
    frames = [logged.frame.can_id for logged in read_frames(path) if logged.is_received]
    assert sorted(set(frames)) == received


def test_a_demo_is_recorded_on_one_time_base(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "hil_bench.abilities.demo.verbs.importlib.util.find_spec", lambda _name: None
    )
    path = tmp_path / "demo.mf4"
    arguments = ["--speed", "max", "--duration", "0.2", "--output", str(tmp_path)]
    assert main(["demo", *arguments, "--record", str(path)]) == 0
    signals = read_recording(path)
    assert signals.tobytes() == read_recording(tmp_path / "demo.csv").tobytes()
    frames = list(read_frames(path))
    in_log = read_frames(tmp_path / "demo.log")  # which does not say who sent a frame
    assert [frame._replace(is_received=None) for frame in frames] == list(in_log)
    assert f"recorded  {len(signals)} rows, {len(frames)} frames: {path}" in capsys.readouterr().out


@pytest.mark.parametrize("mode", [["--speed", "max"], ["--lockstep"]])
def test_a_full_disk_is_said_and_the_run_ends_with_5(tmp_path, monkeypatch, capsys, mode):
    full, sound = tmp_path / "full.csv", tmp_path / "sound.csv"
    append = block_file.OutputFile.append

    def fill(self, data):
        if self.path == full and self.size > 1000:  # after the first block
            raise OSError(errno.ENOSPC, "No space left on device")
        return append(self, data)

    monkeypatch.setattr(block_file.OutputFile, "append", fill)
    monkeypatch.setattr("hil_bench.cli.run_setup.open_transport", lambda *_: SyncOnly())
    words = ["run", "-i", "virtual", "-c", "x", "--duration", "1", *mode]
    assert main([*words, "--record", str(full), "--record", str(sound)]) == 5
    rows = len(read_recording(full))
    problem = (
        f"{full}: recording ended at {(rows - 1) * 1e-3:.3f} s: No space left on device; what was "
        "written before is readable"
    )
    out, err = capsys.readouterr()
    lines = out.splitlines()[-3:]
    # Ticks 0 to 999, or in lock-step the boot at time 0 and 1000 SYNCs.
    assert lines[0].startswith(f"recorded  {rows} rows: {full}")
    assert lines[1:] == [
        f"          {problem}",
        f"          {len(read_recording(sound))} rows: {sound}",
    ]
    assert err == f"hil-bench: {problem}\n"


class SyncOnly:
    """A bus on which a SYNC waits whenever it is asked."""

    description, has_exact_wait = "scripted", False

    def wait(self, _timeout):
        return True

    def receive(self, _limit):
        return [Frame(0x080)]

    def send(self, frames):
        pass

    def listen_to(self, can_ids):
        pass

    def counters(self):
        return TransportCounters()

    def close(self):
        pass


class FilteredBus(SyncOnly):
    """A bus on which a frame for nobody comes in each tick, unless it is filtered out."""

    def __init__(self):
        self.is_filtered = False

    def receive(self, _limit):
        return [] if self.is_filtered else [Frame(0x7FF)]

    def listen_to(self, can_ids):
        self.is_filtered = 0x7FF not in can_ids


@from_text("arguments", "message")
def test_what_cannot_be_meant_ends_before_the_bus_is_opened(arguments, message, cli):
    assert cli([*RUN, *shlex.split(arguments)], 2).err == f"hil-bench: error: {message}\n"
