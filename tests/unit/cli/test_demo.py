"""`hil-bench demo`, as fast as it goes."""

import contextlib
import dataclasses
import errno
import re
from pathlib import Path

import can
import numpy as np
import pytest

from hil_bench.abilities.common import block_file
from hil_bench.abilities.demo.sensors import Shaft
from hil_bench.abilities.demo.session import (
    DemoAxis,
    DemoSession,
    demo_profile,
    setpoint_position,
    tracking_error,
    tuned_parameters,
)
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main
from hil_bench.cli.exit_codes import Interruption
from hil_bench.cli.status_line import StatusLine
from hil_bench.outside.realtime.clock import ScaledClock, VirtualClock
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency
from hil_drivers import DriverError

MACHINES = Path(__file__).parents[3] / "examples" / "machines"


def demo(directory, *arguments):
    return main(["demo", "--speed", "max", "--output", str(directory), *arguments])


@pytest.fixture
def no_plot(monkeypatch):
    """Leave matplotlib out, for speed."""
    monkeypatch.setattr(
        "hil_bench.abilities.demo.verbs.importlib.util.find_spec", lambda _name: None
    )


def test_the_controller_moves_the_cylinder(tmp_path, capsys):
    assert demo(tmp_path / "new", "--duration", "3") == 0
    recording = read_recording(tmp_path / "new" / "demo.csv")
    setpoint, position = recording["axis1.position_setpoint"], recording["axis1.position"]
    moving = np.isfinite(setpoint)
    # The profile goes to 0.4 and then towards -0.3 of half the stroke, h = 0.2 m (Table I).
    assert setpoint[moving].max() == pytest.approx(0.08)
    assert position.max() == pytest.approx(0.08, abs=1e-3)
    error = np.abs(setpoint - position)[moving]
    assert error.max() < 1e-3
    out = capsys.readouterr().out
    assert f"max {error.max() * 1e3:.3f} mm" in out
    assert (tmp_path / "new" / "demo.png").read_bytes().startswith(b"\x89PNG")
    for name in ("demo.csv", "demo.log", "demo.png"):
        assert str(tmp_path / "new" / name) in out


def test_the_controller_turns_a_motor(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.demo.verbs.draw", lambda *_: (None, "none"))
    words = ["--duration", "3", "--sensors", "modbus", str(MACHINES / "drum.toml")]
    assert demo(tmp_path, *words) == 0
    recording = read_recording(tmp_path / "demo.csv")
    turns = recording["axis1.angle"] / (2.0 * np.pi)
    setpoint = recording["axis1.angle_setpoint"] / (2.0 * np.pi)
    moving = np.isfinite(setpoint)
    # To 0.4 of 30 revolutions from where it is; it begins at 0 and sinks a little until then.
    assert setpoint[moving].max() == pytest.approx(12.0, abs=0.1)
    assert turns.max() == pytest.approx(setpoint[moving].max(), abs=0.1)
    error = np.abs(setpoint - turns)[moving]
    assert f"max {error.max():.3f} rev" in capsys.readouterr().out
    assert recording["axis1.angle_seen"][moving].min() > -1.0  # not 4096 revolutions


@pytest.fixture
def no_extra(monkeypatch):
    """Leave the extra for Modbus out."""
    module = "hil_bench.abilities.modbus.serving"
    monkeypatch.setattr(f"{module}.importlib.util.find_spec", lambda _name: None)


def test_the_sensors_may_be_on_modbus_and_the_valve_on_canopen(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.demo.verbs.draw", lambda *_: (None, "none"))
    assert demo(tmp_path, "--duration", "2", "--sensors", "modbus") == 0
    recording = read_recording(tmp_path / "demo.csv")
    error = np.abs(recording["axis1.position_setpoint"] - recording["axis1.position"])
    # As over CANopen, above.
    assert np.nanmax(error) < 1e-3
    assert recording["axis1.position"].max() > 0.07
    assert "0 left out" in capsys.readouterr().out
    with can.LogReader(tmp_path / "demo.log") as reader:
        seen = {message.arbitration_id for message in reader}
    assert {0x181, 0x201} <= seen
    assert not {0x182, 0x183, 0x184} & seen


def test_a_sensor_that_is_no_unit_is_named(tmp_path, make_file, capsys):
    path = make_file("bench.toml", "[modbus.units.pressure_a]\n[modbus.units.pressure_b]\n")
    assert demo(tmp_path, "--sensors", "modbus", str(path)) == 2
    assert "no [modbus.units.NAME] shows nodes.position" in capsys.readouterr().err


@pytest.mark.usefixtures("no_extra")
def test_the_missing_extra_is_named(tmp_path, capsys):
    assert demo(tmp_path, "--sensors", "modbus") == 2
    assert "pip install 'hil-bench[modbus]'" in capsys.readouterr().err


@pytest.mark.usefixtures("no_plot")
def test_the_bus_log_reads_back(tmp_path, capsys):
    assert demo(tmp_path, "--duration", "0.1") == 0
    recording = read_recording(tmp_path / "demo.csv")
    error = 1e3 * (recording["axis1.position_setpoint"] - recording["axis1.position"])
    error = error[np.isfinite(error)]
    lines = [
        f"error     RMS {np.sqrt(np.mean(error**2)):.3f} mm, max {np.abs(error).max():.3f} mm",
        "control   50 cycles of 2 ms, 0 left out",
        f"recording {tmp_path / 'demo.csv'}",
        f"frames    {tmp_path / 'demo.log'}",
        "plot      none, matplotlib is missing: pip install 'hil-bench[plot]'",
    ]
    motion, *others = capsys.readouterr().out.splitlines()
    assert others == lines
    assert re.fullmatch(r"motion    0\.1 s in \d+\.\d s, \d+(\.\d\d)? times real time", motion)
    with can.LogReader(tmp_path / "demo.log") as reader:
        frames = [(message.arbitration_id, bytes(message.data)) for message in reader]
    boot_ups, syncs, commands = {0x701, 0x702, 0x703, 0x704}, {0x080}, {0x201}
    values = {0x181, 0x182, 0x183, 0x184}
    assert boot_ups | syncs | commands | values <= {can_id for can_id, _ in frames}
    # The valve watches the controller: 0x1016.01 = node-ID 127 (0x7F) << 16 | 200 ms, four of the
    # controller's heartbeats of 50 ms; 0x1400.05, the RPDO's time-out: 100 ms, the drivers' own.
    assert (0x601, bytes.fromhex("23161001c8007f00")) in frames
    assert (0x601, bytes.fromhex("2b00140564000000")) in frames
    starts = [data for can_id, data in frames if can_id == 0 and data[0] == 1]
    assert starts == [bytes((1, node)) for node in (1, 2, 3, 4)]
    # Each sensor's drivers make its TPDO send by itself: 0x1800.02, a type of 254 or 255.
    sent = {can_id for can_id, data in frames if data.startswith(bytes.fromhex("2f001802"))}
    assert {0x602, 0x603, 0x604} <= sent


@pytest.mark.usefixtures("no_plot")
def test_interrupted_it_leaves_its_files_and_the_valve_disabled(tmp_path, monkeypatch):
    monkeypatch.setattr(Interruption, "__init__", lambda self: setattr(self, "requested", True))
    assert demo(tmp_path, "--duration", "5") == 130
    recording = read_recording(tmp_path / "demo.csv")
    assert recording["time"][-1] < 1.0
    assert recording["axis1.spool_setpoint"][-1] == 0.0
    with can.LogReader(tmp_path / "demo.log") as reader:
        answers = [bytes(m.data) for m in reader if m.arbitration_id == 0x581]
    status = [data for data in answers if data.startswith(bytes.fromhex("4b416000"))][-1]
    assert status[4] & 0x0F == 0b1001  # 0x6041: DISABLED, R M H D = 1001


def test_an_axis_without_the_sensors_is_refused(tmp_path, capsys):
    (tmp_path / "bench.toml").write_text('[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n')
    assert demo(tmp_path, str(tmp_path / "bench.toml")) == 2
    expected = "plant.axis1: no node is its encoder_406; the demo needs one"
    assert capsys.readouterr().err == f"hil-bench: error: {expected}\n"


@pytest.mark.parametrize("duration", ["0", "-1", "nan", "3601"])
def test_a_senseless_duration_is_refused(tmp_path, duration, capsys):
    assert demo(tmp_path / "none", "--duration", duration) == 2
    assert "give more than 0, up to 3600 s" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("no_plot")
def test_a_recording_may_be_in_the_output_that_the_demo_makes(tmp_path):
    output = tmp_path / "results"
    words = ["--duration", "0.1", "--speed", "max", "--record", str(output / "demo.mf4")]
    assert main(["demo", *words, "--output", str(output)]) == 0
    assert (output / "demo.mf4").stat().st_size > 0


def test_an_output_that_cannot_be_made_is_refused(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert demo(tmp_path / "file" / "below") == 2
    assert "cannot be made" in capsys.readouterr().err


def test_the_controller_fits_the_plant():
    tuned = tuned_parameters(load_config().first_axis)
    # Table I by hand: sigma / m = 100 1/s, a fifth of it; alpha K sqrt(P_S / 2) / mean area
    # = 1e-3 * 6.3059e-4 * sqrt(5e6) / 4.85e-3 = 0.29073 m/s; beta / (alpha + beta) = 0.3 / 1.3.
    assert tuned.position_gain == pytest.approx(20.0)
    assert tuned.full_speed == pytest.approx(0.29073, rel=1e-4)
    assert tuned.dead_zone == pytest.approx(0.230769, rel=1e-5)


def test_the_controller_fits_the_load():
    boom = load_config(MACHINES / "boom.toml").first_axis
    tuned = tuned_parameters(boom)
    # 2 D omega = sigma / m without leakage: 60000 / (16000 + 27) = 3.744 1/s, a fifth of it. The
    # compensator lets 60 l/min pass: 1e-3 m³/s / 78.54e-4 m² = 0.12732 m/s.
    assert tuned.position_gain == pytest.approx(0.7487, rel=1e-3)
    assert tuned.full_speed == pytest.approx(0.12732, rel=1e-4)
    profile = demo_profile(0.0, boom)
    speeds = [profile.at(0.01 * step).speed for step in range(1000)]
    assert max(map(abs, speeds)) < 0.12732


def test_the_controller_fits_a_tank_under_pressure_and_a_slow_spool():
    keys = {
        "tank_pressure_bar": 20,
        "spool_natural_frequency_rad_s": 40,
        "spool_damping_ratio": 0.8,
    }
    tuned = tuned_parameters(load_config(tables={"plant": {"axis1": keys}}).first_axis)
    # As above with (100 - 20) / 2 bar over an edge: 0.29073 sqrt(0.8) m/s. The spool is slower
    # than the piston: a fifth of 2 * 0.8 * 40 1/s.
    assert tuned.full_speed == pytest.approx(0.26004, rel=1e-4)
    assert tuned.position_gain == pytest.approx(12.8)


@pytest.mark.parametrize(
    ("keys", "fastest"),
    [
        ({}, 0.15),  # 60 % of either way's speed are more
        ({"supply_pressure_bar": 50}, None),  # and here less
        ({"load_n": 1e5}, 0.01),  # which it cannot lift
        ({"load_n": -1e5}, 0.01),  # nor pull
    ],
)
def test_the_demo_is_no_faster_than_the_slower_way(keys, fastest):
    axis = load_config(tables={"plant": {"axis1": keys}}).first_axis
    if fastest is None:
        ways = [steady_motion(axis.parameters, axis.options, extends=way) for way in (True, False)]
        fastest = 0.6 * min(way.speed for way in ways)
        assert ways[0].speed != ways[1].speed
        assert 0.01 < fastest < 0.15
    profile = demo_profile(0.0, axis)
    speeds = [abs(profile.at(0.01 * step).speed) for step in range(1500)]
    assert max(speeds) == pytest.approx(fastest)
    assert setpoint_position(profile, 2.0, 2.5) == profile.at(0.5).position != 0.0


def test_a_motor_has_the_controller_of_its_cylinder_at_the_lever():
    """Whose lever is (28 cm³ / 2 pi) to the power of 1/3."""
    motor = load_config(MACHINES / "drum.toml").first_axis
    of_cylinder, lever = tuned_parameters(motor.cylinder), (28e-6 / (2 * np.pi)) ** (1 / 3)
    found = DemoAxis(motor).parameters()
    assert found.full_speed == pytest.approx(of_cylinder.full_speed / lever)
    assert found.tolerance == 2e-3
    same = {"full_speed": found.full_speed, "tolerance": found.tolerance}
    assert found == dataclasses.replace(of_cylinder, **same)
    cylinder = load_config().first_axis
    assert DemoAxis(cylinder).parameters() == tuned_parameters(cylinder)


class Encoder:
    """A rotary sensor that shows what it is asked to."""

    max_age, angle, speed, is_valid, reading, received_at, age = 0.1, 0.0, 2.0, True, "r", 3.0, 4.0

    def __init__(self):
        self.calls = []

    def setup(self):
        self.calls.append("setup")

    def poll(self):
        self.calls.append("poll")
        return True


def test_a_shaft_counts_from_the_turn_in_which_it_begins():
    """An encoder of 4096 turns that begins half a radian below 0 shows the end of its range."""
    turn, encoder = 2.0 * np.pi, Encoder()
    shaft = Shaft(encoder)
    for begin, first in [(-0.5, 4096 * turn - 0.5), (3 * turn + 1, 3 * turn + 1), (0.2, 0.1)]:
        shaft.begin_at(begin)
        for moved in (0.0, -2.0, 2.9 * turn):  # never again by where it is
            encoder.angle = first + moved
            expected = (first if first < 4000 * turn else begin) + moved
            assert shaft.position == pytest.approx(expected, abs=1e-9)
    names = ("max_age", "speed", "is_valid", "reading", "received_at", "age")
    assert [getattr(shaft, name) for name in names] == [getattr(encoder, name) for name in names]
    assert (shaft.setup(), shaft.poll(), encoder.calls) == (None, True, ["setup", "poll"])


@pytest.mark.parametrize(
    ("path", "first", "rest"),
    [
        (None, ["   1.5 s", "set   +40.00 mm"], "x   +40.00 mm"),
        (MACHINES / "drum.toml", ["   1.5 s", "set    +0.500 rev"], "phi    +0.500 rev"),
    ],
)
def test_the_status_shows_time_set_point_and_axis(path, first, rest):
    session = DemoSession(load_config(path), duration=0.1, is_paced=False)
    value = 0.04 if path is None else np.pi
    texts = [field.template.format(value * field.scale) for field in session.fields[1:3]]
    assert [session.fields[0].template.format(1.5), texts[0]] == first
    assert texts[1] == rest
    session._setpoint_at = lambda time: 2.0 * time
    with session.bench:
        session._publish(0.25)
    time, setpoint, position, *others = session.snapshot.read().values
    assert (time, setpoint) == (0.25, 0.5)
    assert position == pytest.approx(session.bench.bench.axes[0].plant.output[0])
    assert len(others) == len(session.fields) - 3


def test_a_controller_that_gets_no_answer_ends_the_demo_in_one_line(tmp_path, cli, monkeypatch):
    def control(*_):
        raise DriverError("node 1 does not answer")

    monkeypatch.setattr(DemoSession, "_control", control)
    found = cli(["demo", "--speed", "max", "--output", str(tmp_path)], 2)
    assert found.err == "hil-bench: error: the demo's controller: node 1 does not answer\n"


def test_a_short_cylinder_is_moved_with_at_most_1_5_m_s2():
    axis = load_config(tables={"plant": {"axis1": {"stroke_mm": 20}}}).first_axis
    profile = demo_profile(0.0, axis)
    speeds = [profile.at(1e-4 * step).speed for step in range(20_000)]
    assert np.abs(np.diff(speeds)).max() / 1e-4 == pytest.approx(1.5, rel=1e-3)


def test_the_tracking_error_counts_the_rows_that_have_a_set_point():
    """Of 3 and -4 mm: 25 / 2 mm² in the mean."""
    rows = np.zeros(3, dtype=[("x", float), ("x_setpoint", float)])
    rows["x"] = 1.0, 1.0, 1.0
    rows["x_setpoint"] = np.nan, 1.003, 0.996
    assert tracking_error(rows, "x") == pytest.approx((1e-3 * np.sqrt(12.5), 4e-3))
    assert np.isnan(tracking_error(rows[:1], "x")).all()


def test_a_shaft_turns_for_ever_as_fast_as_its_swing_lets_it():
    """At 600 rpm: 60 l/min would turn 28 cm³ at 2140 rpm, and so stiff an oil holds nothing up."""
    drum = load_config(MACHINES / "drum.toml").first_axis
    profile = DemoAxis(drum).profile(0.0)
    times = np.arange(1000.0, 1030.0, 0.01)
    speeds = np.array([profile.at(time).speed for time in times])
    assert speeds.max() == pytest.approx(600 * 2.0 * np.pi / 60, rel=1e-3)
    swing = 2.0 * np.pi * eigenfrequency(drum.cylinder, 0.0)
    assert np.abs(np.diff(speeds)).max() / 0.01 <= 0.25 * speeds.max() * swing


def test_a_shaft_is_no_faster_than_the_slower_way_lets_it(make_file):
    text = (MACHINES / "drum.toml").read_text(encoding="utf-8").replace("_bar = 210", "_bar = 85")
    drum = load_config(make_file("slow.toml", text)).first_axis
    p, options = drum.cylinder.parameters, drum.cylinder.options
    out, back = (steady_motion(p, options, extends=way).speed / drum.lever for way in (True, False))
    assert 0.0 < 0.6 * out < min(0.6 * back, 20.0 * np.pi)  # the load is against the one way
    profile = DemoAxis(drum).profile(1.0)
    speeds = [abs(profile.at(0.01 * step).speed) for step in range(2000)]
    assert max(speeds) == pytest.approx(0.6 * out)


def test_only_a_paced_demo_runs_under_the_policy_of_its_bench(monkeypatch):
    config, asked = load_config(), []

    def undisturbed(realtime, tick_ns):
        asked.append((realtime, tick_ns))
        return contextlib.nullcontext()

    monkeypatch.setattr("hil_bench.abilities.demo.session.undisturbed", undisturbed)
    for is_paced in (False, True):
        session = DemoSession(config, duration=0.1, is_paced=is_paced)
        with session.bench, session._undisturbed():
            assert asked == [(config.realtime, config.tick_ns)] * is_paced


def test_a_trigger_without_a_recording_is_refused(tmp_path, capsys):
    assert demo(tmp_path, "--trigger", "axis1.P_A > 80 bar") == 2
    assert "--trigger: begins a recording; give --record FILE too" in capsys.readouterr().err


@pytest.mark.usefixtures("no_plot")
def test_a_lost_recording_ends_it_where_that_is_wished(tmp_path, monkeypatch, capsys):
    """The disk is full after the first block of 0.25 s; the motion would last 3 s."""
    path = tmp_path / "full.csv"
    append = block_file.OutputFile.append

    def fill(self, data):
        if self.path == path and self.size > 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return append(self, data)

    monkeypatch.setattr(block_file.OutputFile, "append", fill)
    words = ["--duration", "3", "--record", str(path), "--end-on-loss"]
    assert demo(tmp_path, *words) == 5
    assert read_recording(tmp_path / "demo.csv")["time"][-1] < 2.0
    capsys.readouterr()


@pytest.mark.long
@pytest.mark.usefixtures("no_plot")
@pytest.mark.parametrize("machine", ["boom", "press"])
def test_a_heavy_load_does_not_swing(tmp_path, machine):
    words = ["demo", str(MACHINES / f"{machine}.toml"), "--speed", "max", "--duration", "6"]
    assert main([*words, "--output", str(tmp_path)]) == 0
    recording = read_recording(tmp_path / "demo.csv")
    moving = np.isfinite(recording["axis1.position_setpoint"])
    spool = recording["axis1.spool_setpoint"][moving]
    turns = np.count_nonzero(np.diff(np.sign(spool[spool != 0.0])))
    # To 0.4, -0.3 and 0.1 of half the stroke in 6 s: the motion turns twice, and the spool may go
    # back and forth once where it stands. Tuned for the bare piston it swung all along.
    assert turns <= 6


@pytest.mark.usefixtures("no_plot")
@pytest.mark.parametrize(("words", "speed"), [([], 1.0), (["--speed", "0.25"], 0.25)])
def test_a_speed_scales_the_clock_that_paces_it(words, speed, tmp_path, cli, monkeypatch):
    clocks, lines = [], []

    def clock_of(_base, speed):
        clocks.append(speed)
        return ScaledClock(VirtualClock(), speed)  # as slow as asked, and nobody waits

    class Status(StatusLine):
        def __init__(self, snapshot, fields, **words):
            lines.extend(map(len, fields))
            super().__init__(snapshot, fields, **words)

    monkeypatch.setattr("hil_bench.abilities.demo.session.ScaledClock", clock_of)
    monkeypatch.setattr("hil_bench.abilities.demo.verbs.StatusLine", Status)
    out = cli(["demo", *words, "--duration", "0.2", "--output", str(tmp_path)]).out
    assert clocks == [speed]
    assert lines == [2, 4]  # time and set-point; position, two pressures, spool
    names = " ".join(line.split()[0] for line in out.splitlines())
    assert names == "motion error control ticks lateness work recording frames plot"
    assert "0 overran, 0 skipped" in out


@pytest.mark.parametrize("speed", ["0", "-1", "fast", "nan"])
def test_a_speed_that_cannot_be_meant(speed, cli):
    assert f"{speed!r}: give a positive number, or max" in cli(["demo", "--speed", speed], 2).err
