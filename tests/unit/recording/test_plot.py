import math
import sys

import pytest

from hil_bench.abilities.recording import plot
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, ChannelRecorder

QUANTITIES = {
    "position_setpoint": "m",
    "position": "m",
    "P_A": "Pa",
    "P_B": "Pa",
    "spool_setpoint": "-",
    "spool_position": "-",
}


def recording(*axes, without=(), spool_unit="-"):
    quantities = QUANTITIES | {"spool_setpoint": spool_unit, "spool_position": spool_unit}
    channels = [
        Channel(f"{axis}.{quantity}", unit)
        for axis in axes
        for quantity, unit in quantities.items()
        if quantity not in without
    ]
    recorder = ChannelRecorder(channels, 3)
    values = {
        "position_setpoint": 0.2,
        "position": 0.15,
        "P_A": 50e5,
        "P_B": 40e5,
        "spool_setpoint": 0.5,
        "spool_position": 0.25,
    }
    for tick in range(3):
        row = [values[channel.name.rpartition(".")[2]] for channel in channels]
        recorder.append([tick * 1e-3, *row])
    return recorder.result()


def drawn(content):
    """The label of each panel and the last value of each of its lines, row by row."""
    figure = plot.result_figure(content)
    return [
        (place.get_ylabel(), [round(float(line.get_ydata()[-1]), 9) for line in place.lines])
        for place in figure.axes
    ]


def test_each_quantity_has_a_panel_in_its_display_unit():
    # 0.2 m - 0.15 m = 50 mm; 5 MPa = 50 bar; 0.5 = 50 %.
    assert drawn(recording("axis1")) == [
        ("Position [mm]", [200.0, 150.0]),
        ("Tracking error [mm]", [50.0]),
        ("Pressure [bar]", [50.0, 40.0]),
        ("Spool [%]", [50.0, 25.0]),
    ]


def test_a_shaft_has_a_panel_in_revolutions():
    recorder = ChannelRecorder([Channel("axis1.angle", "rad"), Channel("axis1.P_A", "Pa")], 2)
    for tick in range(2):
        recorder.append([tick * 1e-3, 4.0 * math.pi * tick, 50e5])
    angle, pressure = plot.result_figure(recorder.result()).axes
    assert (angle.get_ylabel(), pressure.get_ylabel()) == ("Angle [rev]", "Pressure [bar]")
    assert list(angle.lines[0].get_ydata()) == pytest.approx([0.0, 2.0])


def test_a_spool_recorded_in_metres_is_drawn_in_millimetres():
    assert drawn(recording("axis1", spool_unit="m"))[-1] == ("Spool [mm]", [500.0, 250.0])


def test_what_a_recording_lacks_is_left_out():
    assert drawn(recording("axis1", without=("position_setpoint", "P_A", "P_B"))) == [
        ("Position [mm]", [150.0]),
        ("Spool [%]", [50.0, 25.0]),
    ]


def test_set_points_are_dashed_and_behind_the_actual_value():
    content = recording("axis1")
    position = plot.result_figure(content).axes[0]
    setpoint, actual = position.lines

    assert (setpoint.get_linestyle(), actual.get_linestyle()) == ("--", "-")
    assert setpoint.get_zorder() < actual.get_zorder()


def test_a_sensor_that_errs_is_drawn_and_a_fault_is_shaded():
    channels = [
        Channel("a.P_A", "Pa"),
        Channel("good.measured", "Pa"),
        Channel("bad.measured", "Pa"),
    ]
    recorder = ChannelRecorder(channels, 10)
    for tick in range(10):
        actual = 1e5 * tick
        recorder.append([tick * 1e-3, actual, actual + 100.0, min(actual, 3e5)])
    spans = [plot.Span(0.004, 0.009, "freeze bad")]

    (place,) = plot.result_figure(recorder.result(), spans=spans).axes

    assert [line.get_label() for line in place.lines] == ["$P_A$", "bad measured"]
    (shade,) = place.patches
    assert (shade.get_x(), shade.get_x() + shade.get_width()) == pytest.approx((0.004, 0.009))
    assert [text.get_text() for text in place.texts] == [" freeze bad"]


def test_several_axes_stand_side_by_side_on_one_time_axis():
    figure = plot.result_figure(recording("lift", "press"))

    titles = [place.get_title(loc="left") for place in figure.axes]
    assert titles == ["lift", "press", *[""] * 6]
    assert all(place.get_shared_x_axes().joined(place, figure.axes[0]) for place in figure.axes)


def test_a_picture_is_written(tmp_path):
    path = tmp_path / "run.png"
    plot.plot_result(recording("axis1"), path, title="Run")

    assert path.read_bytes().startswith(b"\x89PNG\r\n")


def test_without_matplotlib_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    path = tmp_path / "run.png"
    with pytest.raises(ConfigError) as caught:
        plot.plot_result(recording("axis1"), path)

    assert str(caught.value) == (
        f"{path}: a plot needs matplotlib; install it with: pip install 'hil-bench[plot]'"
    )


def test_a_picture_that_cannot_be_written_says_why(tmp_path):
    path = tmp_path / "no" / "run.png"
    with pytest.raises(ConfigError) as caught:
        plot.plot_result(recording("axis1"), path)
    with pytest.raises(ConfigError, match=r"run\.xyz: cannot be written: .*; give a \.png file"):
        plot.plot_result(recording("axis1"), tmp_path / "run.xyz")

    assert str(caught.value) == (f"{path}: there is no folder {path.parent}; make it first")


def test_a_recording_without_an_axis_is_refused(tmp_path):
    recorder = ChannelRecorder([Channel("tick.work", "s")], 1)
    path = tmp_path / "run.png"
    with pytest.raises(ConfigError) as caught:
        plot.plot_result(recorder.result(), path)

    assert str(caught.value) == (f"{path}: the recording has no axis to plot; record its channels")
