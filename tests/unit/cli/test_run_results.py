"""What `hil-bench run` prints for a program, and that it prints nothing under --quiet."""

import json

import pytest

from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.errors import BusError
from hil_bench.outside.transports.transport import TransportCounters

CHANNEL = "test_run_results"
RUN = ["run", "-i", "virtual", "-c", CHANNEL, "--speed", "max", "--duration", "0.2"]
FAULT = ["--fault", "freeze", "pressure_a", "at_s=0.1"]


def test_a_program_reads_the_summary_alone(tmp_path, cli):
    recording = tmp_path / "run.mf4"
    out, err = cli([*RUN, "--json", *FAULT, "--record", str(recording)])
    found = json.loads(out)
    assert found["bench_time"] == 0.2
    assert found["loop"] == {"tick_us": 1000.0, "ticks": 200, "overruns": 0, "skipped": 0}
    assert found["faults"] == [
        {"time": 0.1, "kind": "freeze", "target": "pressure_a", "begins": True}
    ]
    assert found["frames"]["sent"] == 4  # a boot-up message of each node
    assert [node["name"] for node in found["nodes"]] == [
        "valve",
        "pressure_a",
        "pressure_b",
        "position",
    ]
    (file,) = found["recording"]["files"]
    assert file["rows"] == len(read_recording(recording)["time"])
    assert found["recording"]["is_complete"]
    assert found["ended_by"] is None
    # The introduction and what happens are for people.
    assert err.startswith("bench  built-in bench, 1000 Hz")
    assert err.endswith("hil-bench: 0.100 s: fault freeze pressure_a begins\n")


class ScriptedBus:
    """A bus with all of a controller's frames; it is lost after the last of them."""

    description = "scripted"
    has_exact_wait = False

    def __init__(self, *frames):
        self.frames = list(frames)

    def listen_to(self, can_ids):
        pass

    def wait(self, _timeout):
        return True

    def receive(self, limit):
        if not self.frames:
            raise BusError("the bus is gone")
        taken, self.frames = self.frames[:limit], self.frames[limit:]
        return taken

    def send(self, frames):
        pass

    def counters(self):
        return TransportCounters()

    def close(self):
        pass


def put_in_place(monkeypatch, bus):
    monkeypatch.setattr("hil_bench.cli.run_setup.open_transport", lambda *_: bus)


@pytest.mark.parametrize("mode", [[], ["--lockstep"]])
def test_a_lost_bus_leaves_its_summary_and_an_error(mode, monkeypatch, cli):
    put_in_place(monkeypatch, ScriptedBus())
    words = ["run", "-i", "virtual", "-c", CHANNEL, *mode]
    out, err = cli([*words, "--json"], 3)
    assert json.loads(out)["ended_by"] == "the bus is gone"
    assert err.endswith("hil-bench: error: the bus is gone\n")
    assert cli([*words, "-q"], 3) == ("", "hil-bench: error: the bus is gone\n")


def test_in_lock_step_a_program_gets_how_far_it_went(monkeypatch, cli):
    put_in_place(monkeypatch, ScriptedBus(*[Frame(0x080)] * 5))
    words = ["run", "-i", "virtual", "-c", CHANNEL, "--lockstep", "--sync-period-us", "2000"]
    found = json.loads(cli([*words, "--duration", "0.01", "--json"]).out)
    assert (found["syncs"], found["sync_period"], found["bench_time"]) == (5, 0.002, 0.01)


def test_quiet_prints_nothing(cli):
    assert cli([*RUN, "-q", *FAULT]) == ("", "")


def test_a_check_or_a_replay_says_nothing_under_quiet_either(make_file, cli):
    log = make_file("bus.log", "(0.1) can0 181#0102\n(0.2) can0 080#\n")
    assert main(["check", "-q"]) == 0
    assert cli(["replay", str(log), "-i", "virtual", "-c", CHANNEL, "-q"]) == ("", "")
