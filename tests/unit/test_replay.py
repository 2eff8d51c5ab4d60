"""Frames on a bus with their timing, set-points into the plant."""

import numpy as np
import pytest
from numpy.lib import recfunctions

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.replay.drive import (
    FrameDirection,
    compare_recordings,
    drive_plant,
    play_frames,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.recording.channels import Channel, LoggedFrame, recording_dtype

FRAMES = [
    LoggedFrame(Frame(number), 5_000_000_000 + number * 1_000_000, bool(number % 2))
    for number in range(4)
]


@pytest.mark.parametrize("speed", [1.0, 2.0, float("inf")])
def test_frames_are_sent_at_their_times_from_the_first_on(speed):
    clock, sent = VirtualClock(1_000), []
    report = play_frames(
        FRAMES, lambda logged: sent.append((logged.frame.can_id, clock.now())), clock, speed=speed
    )
    assert sent == [(number, 1_000 + round(number * 1_000_000 / speed)) for number in range(4)]
    assert (report.frames, report.latest) == (4, 0.0)
    assert report.duration == pytest.approx(3e-3 / speed)


def test_a_slow_bus_is_told():
    clock = VirtualClock()
    report = play_frames(FRAMES, lambda _logged: clock.advance(3_000_000), clock)
    # Frames of 1 ms distance that take 3 ms each: the fourth comes 9 ms after the first, not 3 ms.
    assert report.latest == pytest.approx(6e-3)


def test_it_stops_when_told():
    sent = []
    report = play_frames(FRAMES, sent.append, VirtualClock(), stopped=lambda: len(sent) == 2)
    assert report.frames == 2


@pytest.mark.parametrize(
    ("direction", "expected"), [("received", [1, 3]), ("sent", [0, 2]), ("all", [0, 1, 2, 3])]
)
def test_a_direction_is_that_of_who_recorded(direction, expected):
    chosen = [f.frame.can_id for f in FRAMES if FrameDirection(direction).includes(f)]
    assert chosen == expected


@pytest.fixture(scope="module")
def recorded():
    """The built-in bench with its spool moved by hand: valve to 40 %, back, to -30 %."""
    with VirtualBench() as bench:
        bench.run(0.05)
        for number, fraction in enumerate((0.4, 0.0, -0.3)):
            axis = bench.bench.axes[0]
            axis.valve.command = lambda _now, u=fraction * axis.valve.full_opening: u
            bench.run(0.1 + 0.05 * number)
        return bench.signals


def test_the_same_plant_does_the_same_to_the_last_bit(recorded):
    simulated = drive_plant(load_config(), recorded)
    assert np.ptp(recorded["axis1.position"]) > 1e-3
    deviations = compare_recordings(load_config(), recorded, simulated, {})
    assert [d.channel.rpartition(".")[2] for d in deviations] == [
        "position",
        "speed",
        "P_A",
        "P_B",
        "spool_position",
    ]
    assert [d.maximum for d in deviations] == [0.0] * 5
    assert {d.verdict for d in deviations} == {"passed", "not judged"}


def test_it_goes_on_from_the_middle_of_a_motion(recorded):
    later = recorded[120:]
    (position, *_) = compare_recordings(load_config(), later, drive_plant(load_config(), later), {})
    # The spool's velocity alone is not recorded; its lag is some milliseconds at most.
    assert position.maximum < 1e-4


def test_another_plant_is_out_of_tolerance(recorded, load_bench):
    other = load_bench("[plant.axis1]\nbulk_modulus_mpa = 40\nsupply_pressure_bar = 130\n")
    deviations = compare_recordings(load_config(), recorded, drive_plant(other, recorded), {})
    pressure = next(d for d in deviations if d.channel == "axis1.P_A")
    assert pressure.verdict == "failed"
    assert pressure.maximum > 2e5


def test_a_tolerance_is_for_a_channel_or_for_all_of_its_quantity(recorded):
    simulated = drive_plant(load_config(), recorded)
    simulated["axis1.position"] += 2e-3
    for name in ("position", "axis1.position"):
        (deviation, *_) = compare_recordings(load_config(), recorded, simulated, {name: 3e-3})
        assert (deviation.maximum, deviation.tolerance) == pytest.approx((2e-3, 3e-3))
        assert deviation.verdict == "passed"
    (deviation, *_) = compare_recordings(load_config(), recorded, simulated, {})
    assert deviation.verdict == "failed"
    with pytest.raises(ConfigError, match=r"^tolerance for axis9\.position: not compared; P_A, "):
        compare_recordings(load_config(), recorded, simulated, {"axis9.position": 1.0})
    lacking = recfunctions.drop_fields(recorded, "axis1.P_B")
    with pytest.raises(ConfigError, match=r"^tolerance for P_B: not compared; P_A, "):
        compare_recordings(load_config(), lacking, simulated, {"P_B": 1.0})


def test_a_deviation_has_its_greatest_value_with_its_time_and_its_rms(recorded):
    """Half of the rows are off by 1 mm, the tenth by -4 mm: rms² is (n / 2 + 16) / n mm²."""
    simulated = drive_plant(load_config(), recorded)
    simulated["axis1.position"] = recorded["axis1.position"]
    count = len(recorded) // 2
    simulated["axis1.position"][-count:] += 1e-3
    simulated["axis1.position"][9] -= 4e-3
    (deviation, *_) = compare_recordings(load_config(), recorded, simulated, {})
    assert deviation.maximum == pytest.approx(4e-3)
    assert deviation.time == recorded["time"][9]
    assert deviation.rms == pytest.approx(1e-3 * np.sqrt((count + 16) / len(recorded)))


def unknown_in(rows, name, where):
    rows = rows.copy()
    rows[name][where] = np.nan
    return rows


@pytest.mark.parametrize(
    ("change", "seen", "verdict"),
    [
        (lambda rows: unknown_in(rows, "axis1.position", slice(-100, None)), 0.1, "inconclusive"),
        (lambda rows: unknown_in(rows, "axis1.position", 0), 0.001, "inconclusive"),
        (lambda rows: np.delete(rows, slice(200, 250)), 0.051, "inconclusive"),
        (lambda rows: np.delete(rows, slice(200, 209)), 0.0, "passed"),  # ten times the usual
    ],
)
def test_what_was_not_seen_throughout_has_not_passed(recorded, change, seen, verdict):
    """The last 0.1 s or the first row without a position; two rows that are 51 ms apart."""
    (position, *_) = compare_recordings(load_config(), change(recorded), change(recorded), {})
    assert position.duration == pytest.approx(np.ptp(recorded["time"]))
    assert position.duration - position.seen == pytest.approx(seen)
    assert (position.maximum, position.verdict) == (0.0, verdict)


def test_what_was_seen_out_of_tolerance_has_failed_though_some_was_not(recorded):
    part = unknown_in(recorded, "axis1.position", slice(-100, None))
    part["axis1.position"][20] += 2e-3
    (position, *_) = compare_recordings(load_config(), part, recorded, {})
    assert (position.maximum, position.verdict) == (pytest.approx(2e-3), "failed")
    assert position.time == recorded["time"][20]
    assert position.rms == pytest.approx(2e-3 / np.sqrt(len(recorded) - 100))


def test_a_pressure_that_is_unknown_at_first_is_not_begun_with(recorded):
    part = unknown_in(recorded, "axis1.P_A", slice(0, 1))
    simulated = drive_plant(load_config(), part)
    assert np.isfinite(simulated["axis1.P_A"]).all()


def leaping(rows, time, row=7):
    """Return eight rows of 1 ms, one of them of another time."""
    rows = rows[:8].copy()
    rows["time"] = np.arange(8) / 1000
    rows["time"][row] = time
    return rows


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[:1], "the recording has 1 rows of signals; 2 or more are needed"),
        (
            lambda rows: rows[["time", "axis1.position"]],
            "the recording has no spool set-point; it must have axis1.spool_setpoint",
        ),
        (
            lambda rows: rows[["time", "axis1.spool_setpoint"]],
            "the recording has no axis1.position; it must have one to begin with",
        ),
        (
            lambda rows: unknown_in(rows, "axis1.position", slice(0, 1)),
            "the recording has no axis1.position in its first row; it must have one to begin with",
        ),
        (
            lambda rows: unknown_in(rows, "axis1.spool_setpoint", slice(9, 12)),
            (
                "axis1.spool_setpoint is unknown in 3 rows, first in row 10, at 0.01 s; "
                "give a recording that has it in each row"
            ),
        ),
        (
            lambda rows: rows[::-1],
            "the recording's time goes back; give a recording in the order of time",
        ),
        (
            lambda rows: leaping(rows, 1e9),
            "the recording's row after 0.006 s is at 1e+09 s; give rows at most 3600 s apart",
        ),
        (
            lambda rows: leaping(rows, np.nan),
            "the recording's row after 0.006 s is at nan s; give rows at most 3600 s apart",
        ),
        (
            lambda rows: leaping(rows, np.nan, row=0),
            "the recording's row after nan s is at 0.001 s; give rows at most 3600 s apart",
        ),
    ],
)
def test_a_recording_that_lacks_what_is_needed(recorded, change, message):
    with pytest.raises(ConfigError) as caught:
        drive_plant(load_config(), change(recorded))
    assert str(caught.value) == message


def test_rows_between_the_steps_of_the_plant_shift_nothing(recorded):
    """50 rows each 1.02 ms: rounded one by one to steps of 0.05 ms they would be 50 ms, not 51."""
    rows = np.zeros(51, dtype=recorded.dtype)
    rows["axis1.spool_setpoint"] = 0.5
    even = rows.copy()
    rows["time"] = 1.02e-3 * np.arange(51)
    even["time"] = 1.0e-3 * np.arange(51) + np.where(np.arange(51) == 50, 1.0e-3, 0.0)
    ends = [drive_plant(load_config(), each)["axis1.position"][-1] for each in (rows, even)]
    assert ends[0] == ends[1] != 0.0


def test_a_recording_without_pressures_begins_at_rest(recorded):
    channels = [
        Channel("time", "s"),
        Channel("axis1.position", "m"),
        Channel("axis1.spool_setpoint", "-"),
    ]
    rows = np.zeros(len(recorded), dtype=recording_dtype(channels))
    for channel in channels:
        rows[channel.name] = recorded[channel.name]
    (position,) = compare_recordings(load_config(), rows, drive_plant(load_config(), rows), {})
    assert position.maximum < 1e-6


SHARED = """
[supply]
hpu = { pump_flow_l_min = 30, start_temperature_c = 50, accumulator_volume_l = 0 }

[plant.lift]
supply = "hpu"

[plant.winch]
kind = "rotary"
displacement_cm3_rev = 28
inertia_kg_m2 = 0.05
supply = "hpu"

[nodes]
lift_valve = { profile = "valve_408", axis = "lift", node_id = 1 }
winch_valve = { profile = "valve_408", axis = "winch", node_id = 2 }
"""


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Two axes on one pump, one after the other: the bench's configuration and what it did."""
    path = tmp_path_factory.mktemp("shared") / "bench.toml"
    path.write_text(SHARED)
    config = load_config(path)
    with VirtualBench(config) as bench:
        bench.run(0.05)
        for axis in bench.bench.axes:
            axis.valve.command = lambda _now, full=axis.valve.full_opening: 0.5 * full
            bench.run(0.1)
        return config, bench.signals


def test_axes_on_one_supply_are_driven_together(shared):
    config, recorded = shared
    assert recorded["lift.P_S"].min() < 0.6 * recorded["lift.P_S"].max()
    deviations = compare_recordings(config, recorded, drive_plant(config, recorded), {})
    for each in deviations:
        size = np.abs(recorded[each.channel]).max()
        assert each.maximum <= 1e-9 * size, each.channel
    assert {"lift.P_S", "winch.Q_S", "lift.T_oil", "winch.angle"} <= {d.channel for d in deviations}


def test_they_go_on_from_the_middle_of_a_motion(shared):
    config, recorded = shared
    later = recorded[170:]
    for each in compare_recordings(config, later, drive_plant(config, later), {}):
        assert each.verdict in {"passed", "not judged"}, each


def test_one_of_them_alone_is_refused(shared):
    config, recorded = shared
    names = [name for name in recorded.dtype.names if name != "winch.spool_setpoint"]
    with pytest.raises(ConfigError) as caught:
        drive_plant(config, recorded[names])
    right = "it must have one, for winch and lift share their supply"
    assert str(caught.value) == f"the recording has no winch.spool_setpoint; {right}"
