"""Which column is which quantity."""

from contextlib import nullcontext

import numpy as np
import pytest
from support.tables import from_text

from hil_bench.abilities.recording.column_map import (
    check_units,
    map_columns,
    read_column_map,
    take_sensors,
)
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, recording_dtype

RIG = """
[time]
column = "t"
unit = "ms"

[position]
column = "s"
unit = "mm"
gain = 2.0
offset = -5.0
polarity = -1

[spool_setpoint]
column = "U"
unit = "V"

[P_A]
column = "p"
unit = "bar"

[files."b.csv"]
P_A = false

[files."b.csv".P_B]
column = "p"
unit = "MPa"
"""
TABLE = {
    "t": np.array([100.0, 101.0]),
    "s": np.array([1.0, 2.0]),
    "U": np.array([-10.0, 5.0]),
    "p": np.array([3.0, 4.0]),
}


def write(directory, text):
    path = directory / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_column_becomes_its_quantity_in_si(tmp_path):
    columns = read_column_map(write(tmp_path, RIG), [])

    found = map_columns(TABLE, columns.of("a.csv"), "lift")

    assert found["time"] == pytest.approx([0.0, 1e-3])
    # -2 mm/mm, and 5 mm less
    assert found["lift.position"] == pytest.approx([-7e-3, -9e-3])
    assert found["lift.spool_setpoint"] == pytest.approx([-1.0, 0.5])  # of 10 V
    assert found["lift.P_A"] == pytest.approx([3e5, 4e5])
    assert "lift.P_B" not in (found.dtype.names or ())


def test_a_sensor_may_sit_elsewhere_in_one_file(tmp_path):
    columns = read_column_map(write(tmp_path, RIG), [])

    found = map_columns(TABLE, columns.of("b.csv"), "lift")

    assert found["lift.P_B"] == pytest.approx([3e6, 4e6])
    assert "lift.P_A" not in (found.dtype.names or ())


@pytest.mark.parametrize(("unit", "share"), [("%", 0.05), ("-", 5.0), ("V", 0.5), ("mA", 0.25)])
def test_a_command_has_the_unit_of_its_amplifier(unit, share):
    options = [f"t=time:{'s'}", "s=position:mm", f"U=-spool_setpoint:{unit}"]

    found = map_columns(TABLE, read_column_map(None, options).of("a.csv"), "lift")

    assert found["lift.spool_setpoint"][1] == pytest.approx(-share)


def test_a_full_scale_takes_the_place_of_the_usual_one(tmp_path):
    text = RIG.replace('unit = "V"', 'unit = "V"\nfull_scale = 5')

    columns = read_column_map(write(tmp_path, text), [])

    found = map_columns(TABLE, columns.of("a.csv"), "lift")
    assert found["lift.spool_setpoint"] == pytest.approx([-2.0, 1.0])


@from_text("old", "new", "complaint")
def test_a_map_with_a_mistake_is_refused(tmp_path, old, new, complaint):
    assert old in RIG
    with pytest.raises(ConfigError) as error:
        read_column_map(write(tmp_path, RIG.replace(old, new)), [])

    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("option", ["s", "s=speed:mm", "=position:mm", "s=position", "s=P_A:mm"])
def test_an_option_with_a_mistake_is_refused(option):
    with pytest.raises(ConfigError, match=f"--map {option}: "):
        read_column_map(None, [option])


def test_a_column_that_is_not_there_is_named(tmp_path):
    columns = read_column_map(write(tmp_path, RIG), ["x=position:mm"])

    with pytest.raises(ConfigError, match="position is to be column x; the file has t, s, U, p"):
        map_columns(TABLE, columns.of("a.csv"), "lift")


def test_a_map_without_time_and_command_names_both_and_the_columns_to_choose_from():
    columns = read_column_map(None, ["s=position:mm"])

    with pytest.raises(ConfigError) as error:
        map_columns(TABLE, columns.of("a.csv"), "lift")

    assert str(error.value) == (
        "no column is time and spool_setpoint; give each in --columns or with --map "
        "COLUMN=time:UNIT; the file has t, s, U, p"
    )


def test_what_sensors_measured_counts_before_what_only_the_plant_knows():
    names = ("axis1.position", "axis1.P_A", "encoder.measured", "pressure.measured")
    channels = [Channel("time", "s"), *(Channel(name, "m") for name in names)]
    bench = np.array([(0.0, 1.0, 2.0, 1.5, 2.5)], dtype=recording_dtype(channels))

    found, note = take_sensors(bench, "axis1", {"position": "encoder", "P_B": "other"})

    assert found[["axis1.position", "axis1.P_A"]].tolist() == [(1.5, 2.0)]
    assert bench["axis1.position"] == 1.0
    assert note == ("taken: position from encoder.measured; P_A from axis1.P_A, the plant's own")


def test_a_recording_of_a_machine_is_taken_as_it_is():
    channels = [Channel("time", "s"), Channel("axis1.position", "m")]
    machine = np.array([(0.0, 1.0)], dtype=recording_dtype(channels))
    assert take_sensors(machine, "axis1", {"position": "encoder"}) == (machine, "")


@pytest.mark.parametrize("unit", ["mm", "[m]", "bar", "°C"])
def test_a_map_that_contradicts_the_unit_of_the_file_is_refused(unit):
    columns = read_column_map(None, ["s=position:cm"])

    with pytest.raises(ConfigError, match="the map has position in cm"):
        check_units({"s": unit}, columns.of("a.csv"))


@pytest.mark.parametrize(
    ("option", "unit", "wrong"),
    [
        ("p=P_A:bar", "mA", "P_A in bar; give gain and offset in a file for --columns"),
        ("p=P_A:bar", "(mV)", 'is in "mV" there'),
        ("p=position:mm", "[counts]", 'is in "counts" there'),
        ("p=spool_setpoint:V", "mV", "spool_setpoint in V; give gain and offset"),
        ("p=spool_setpoint:%", "V", "spool_setpoint in %; give it in V"),
        ("p=spool_setpoint:mA", "[mA]", ""),
        ("p=spool_setpoint:V", "V", ""),
    ],
)
def test_a_sensors_signal_is_no_quantity_without_a_gain(option, unit, wrong):
    mapped = read_column_map(None, [option]).of("a.csv")
    with pytest.raises(ConfigError, match=wrong) if wrong else nullcontext():
        check_units({"p": unit}, mapped)


@pytest.mark.parametrize("unit", ["mm", "", "furlong", "1"])
def test_a_unit_of_the_file_that_says_the_same_or_nothing_is_taken(unit):
    check_units({"s": unit}, read_column_map(None, ["s=position:mm"]).of("a.csv"))


def test_the_unit_of_a_raw_column_is_not_that_of_its_quantity(tmp_path):
    columns = read_column_map(write(tmp_path, RIG), [])

    check_units({"s": "bar", "U": "V"}, columns.of("a.csv"))  # gain 2, offset -5 mm
