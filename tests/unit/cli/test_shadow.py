"""`hil-bench shadow` on the recorded frames of a machine."""

import contextlib
import io
import json
import re

import pytest
from support.tables import from_text

from hil_bench.abilities.common.work import WorkView
from hil_bench.abilities.recording.frames import message_of, read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.shadow import verbs as shadow
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.cli import main


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a recording of the demo's bus, which nobody changes."""
    folder = tmp_path_factory.mktemp("demo")
    path = folder / "machine.log"
    demo = ["demo", "--speed", "max", "--duration", "1.5", "--output", str(folder / "demo"), "-q"]
    with contextlib.redirect_stdout(io.StringIO()):
        assert main([*demo, "--record", str(path)]) == 0
    return path


def test_joining_and_windows_are_told_and_the_worst_at_the_end(log, cli):
    out, err = cli(["shadow", "--log", str(log)])
    assert re.fullmatch(r" +0\.\d\d s  axis1  the twin follows; its valve is ACTIVE\n", err)
    assert "axis1  position" in out
    assert "windows, 0 of them beyond a limit; the worst:" in out
    assert "limit 0.500 mm: ok" in out
    assert "compared for" not in out
    assert out.endswith("verdict: follows; the machine does what its twin does\n")


def test_a_limit_that_is_passed_is_exit_code_1(log, cli):
    limits = ["--position-mm", "0.000001", "--horizon", "0.2"]
    out = cli(["shadow", "--log", str(log), *limits], 1).out
    assert "limit 0.000 mm: TOO MUCH" in out
    assert " mm !" in out
    assert out.endswith("verdict: differs; the machine does something else than its twin\n")


def test_json_and_a_recording_of_both_sides(log, tmp_path, cli):
    csv = tmp_path / "residuals.csv"
    content = json.loads(cli(["shadow", "--log", str(log), "--json", "--record", str(csv)]).out)
    assert content["exceeded"] == 0
    assert content["verdict"] == "follows"
    assert set(content["worst"]["axis1"]) == {"position", "P_A", "P_B", "spool_position"}
    names = read_recording(csv).dtype.names
    assert names[0] == "time"
    assert {"axis1.position", "axis1.position_twin", "axis1.P_A_twin"} <= set(names)


@from_text("arguments", "message")
def test_a_mistake_is_one_line_and_exit_code_2(arguments, message, cli):
    assert message in cli(["shadow", *arguments.split()], 2).err


def test_a_bus_without_the_machine_says_what_is_missing(tmp_path, cli):
    log = tmp_path / "quiet.log"
    with VirtualBench(record=log) as bench:
        bench.run(0.1)  # boot-ups, and nothing more: the nodes are not started
    assert cli(["shadow", "--log", str(log)], 6).err == (
        "axis1: nothing was compared in 0.0 s, 4 frames heard; missing: "
        "position (node 4, PDO 0x184, PRE_OPERATIONAL): not heard; "
        "P_A (node 2, PDO 0x182, PRE_OPERATIONAL): not heard; "
        "P_B (node 3, PDO 0x183, PRE_OPERATIONAL): not heard; "
        "state of the valve (node 1, PDO 0x181, PRE_OPERATIONAL): not heard\n"
    )


def test_the_frames_of_another_channel_are_no_part_of_the_machine(log, tmp_path, cli):
    """On can1 the same position PDO says 0.1 m, each time before that of the machine."""
    lines = []
    for line in log.read_text().splitlines(keepends=True):
        if " can0 184#" in line:
            lines.append(f"{line.partition(' ')[0]} can1 184#A08601000000\n")
        lines.append(line)
    both = tmp_path / "both.log"
    both.write_text("".join([*lines[:9], "(0.1) can0 18\n", *lines[9:]]))
    out, err = cli(["shadow", "--log", str(both)])
    assert out == cli(["shadow", "--log", str(log)]).out
    assert "line 10 is no frame of its format" in err
    assert f"frames of other channels left out ({sum(' can1 ' in each for each in lines)} of" in err


@pytest.mark.parametrize(
    ("cut", "verdict", "code"),
    [
        (0.35, {"axis1": {"P_A": 0.2}}, 6),  # windows of 0.1 s from 0.18 s on: the third has none
        (0.75, {}, 0),  # a silence shorter than the patience of 1 s
    ],
)
def test_what_was_compared_for_a_part_of_the_time_does_not_follow(
    log, tmp_path, cli, cut, verdict, code
):
    silent = tmp_path / "silent.log"
    lines = log.read_text().splitlines(keepends=True)
    kept = [line for line in lines if " 182#" not in line or float(line[1:9]) < cut]
    silent.write_text("".join(kept))
    shown = ["shadow", "--log", str(silent), "--horizon", "0.1"]
    content = json.loads(cli([*shown, "--json"], code).out)
    assert content["verdict"] == ("in part" if code else "follows")
    seen = {
        axis: {name: round(gap["compared"], 1) for name, gap in gaps.items() if name == "P_A"}
        for axis, gaps in content["gaps"].items()
    }
    assert seen == verdict
    if code:
        out = cli(shown, code).out
        assert "axis1 P_A: compared for 0.20 s, and not from 0.38 s to" in out
        assert "misses at the end P_A (node 2, PDO 0x182): silent for 1.2 s" in out


class SilentBus:
    """A bus on which waiting takes the time of a clock that a test made.

    Attributes:
        messages: those that come before it is silent.
    """

    def __init__(self):
        self.now = 0.0
        self.messages = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def recv(self, timeout):
        if self.messages:
            message = self.messages.pop(0)
            self.now = message.timestamp
            return message
        self.now += timeout
        return None


@pytest.fixture
def silent_bus(monkeypatch):
    bus = SilentBus()
    monkeypatch.setattr("hil_bench.abilities.shadow.verbs.open_can_bus", lambda *_: (bus, "silent"))
    monkeypatch.setattr("hil_bench.abilities.shadow.verbs.time.monotonic", lambda: bus.now)
    return bus


def test_the_duration_ends_where_nothing_is_heard(silent_bus, capsys):
    assert main(["shadow", "--duration", "3"]) == 6
    assert 3.0 <= silent_bus.now < 3.3  # a wait for frames takes 0.2 s
    waits, ended = capsys.readouterr().err.splitlines()
    assert waits.startswith("    0.00 s  axis1  waits for position (node 4, PDO 0x184): not heard;")
    assert ended.startswith("axis1: nothing was compared in 3.0 s, 0 frames heard; missing: posi")


def test_a_bus_that_falls_silent_is_compared_in_part(log, silent_bus, cli):
    silent_bus.messages = [message_of(logged) for logged in read_frames(log)]
    out = cli("shadow --duration 3 --horizon 0.1", 6).out
    assert re.search(r"compared for 1\.\d\d s, and not from 1\.\d\d s to 3\.\d\d s\n", out)
    assert out.endswith(
        "verdict: in part; the machine did what its twin did while it could be compared\n"
    )


@pytest.mark.usefixtures("silent_bus")
def test_json_says_what_was_missing(cli):
    content = json.loads(cli("shadow --duration 3 --json", 6).out)
    assert content["verdict"] == "not compared"
    assert content["missing"]["axis1"]["position (node 4, PDO 0x184)"] == "not heard"


def test_a_bench_without_sensors_is_refused_before_the_bus_is_opened(make_file, cli):
    bench = make_file("bench.toml", '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n')
    assert cli(["shadow", str(bench), "--duration", "1"], 2).err == (
        f"hil-bench: error: {bench}: no node reports position, P_A and P_B of axis1 on the bus; "
        "give it an encoder_406 and a pressure_404 at each port\n"
    )


def test_an_axis_without_sensors_is_no_part_of_the_verdict(log, make_file, cli):
    nodes = {
        "valve": (1, "valve_408", 'axis = "axis1"\n'),
        "a": (2, "pressure_404", 'axis = "axis1"\nsource = "P_A"\n'),
        "b": (3, "pressure_404", 'axis = "axis1"\nsource = "P_B"\n'),
        "position": (4, "encoder_406", 'axis = "axis1"\n'),
        "lift_valve": (5, "valve_408", 'axis = "lift"\n'),
    }
    text = "[plant.axis1]\n[plant.lift]\n" + "".join(
        f'[nodes.{name}]\nprofile = "{profile}"\nnode_id = {node_id}\n{more}'
        for name, (node_id, profile, more) in nodes.items()
    )
    words = ["shadow", str(make_file("bench.toml", text)), "--log", str(log)]
    end = "the machine does what its twin does; without sensors, so not compared: lift\n"
    assert cli(words).out.endswith(f"verdict: follows; {end}")
    assert json.loads(cli([*words, "--json"]).out)["without_sensors"] == ["lift"]


def test_those_who_watch_a_quiet_one_see_both_sides_and_the_worst_window(log, monkeypatch, cli):
    rows, states = [], []

    class View(WorkView):
        is_watched = True

        def show(self, **changes):
            super().show(**changes)
            states.append(self.state)

        def put_row(self, values):
            rows.append(values)

    @contextlib.contextmanager
    def watched(_args, verb, _title, channels):
        assert verb == "shadow"
        assert [channel.name for channel in channels][:2] == [
            "axis1.position",
            "axis1.position_twin",
        ]
        yield View()

    monkeypatch.setattr(shadow, "watched_work", watched)
    assert cli(["shadow", "--log", str(log), "--quiet"]) == ("", "")
    assert states[-1].verdict == "follows"
    assert states[-1].now == "axis1: the twin follows"
    assert states[-1].counts["beyond a limit"] == 0
    assert {item.verdict for item in states[-1].items} == {"follows"}
    times = [row[0] for row in rows]
    assert times == sorted(times)
    # The machine of the recording is a bench without noise: the twin is within its limit, 0.5 mm.
    assert abs(rows[-1][1] - rows[-1][2]) < 0.5e-3
