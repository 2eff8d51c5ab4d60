"""`hil-bench registers`."""

import csv
from pathlib import Path

from hil_bench.cli import main


def test_the_table_names_each_unit_and_register(cli):
    lines = cli("registers").out.splitlines()
    assert [line for line in lines if line.startswith("unit")] == [
        "unit 2  pressure_a  pressure_404",
        "unit 3  pressure_b  pressure_404",
        "unit 4  position  encoder_406",
    ]
    (pressure,) = [line.split() for line in lines[:12] if " 30001 " in line]
    assert pressure[:8] == ["0", "30001", "pressure", "float32", "bar", "1", "r", "big"]


def test_csv_has_a_line_a_register(cli, make_file):
    path = make_file("bench.toml", '[modbus.units.valve]\nunit_id = 9\nword_order = "little"\n')
    rows = list(csv.DictReader(cli(["registers", str(path), "--csv"]).out.splitlines()))
    by_name = {row["name"]: row for row in rows}
    assert by_name["spool_setpoint"] == {
        "unit_id": "9",
        "unit": "valve",
        "table": "holding_registers",
        "address": "0",
        "reference": "40001",
        "name": "spool_setpoint",
        "type": "float32",
        "count": "2",
        "word_order": "little",
        "unit_of_measure": "-",
        "scale": "1",
        "access": "r",  # commands are not allowed
        "description": "Spool set-point as fraction of full opening",
    }
    assert by_name["enable"]["type"] == "bit"
    assert by_name["enable"]["scale"] == ""


def test_a_motor_has_its_encoder_among_the_sensors(cli):
    drum = Path(__file__).parents[3] / "examples" / "machines" / "drum.toml"
    rows = list(csv.DictReader(cli(["registers", str(drum), "--csv"]).out.splitlines()))
    units = {row["unit_id"]: row["unit"] for row in rows}
    assert units == {"2": "pressure_a", "3": "pressure_b", "4": "encoder"}
    shown = {row["name"]: row["unit_of_measure"] for row in rows if row["unit"] == "encoder"}
    assert (shown["angle"], shown["speed"], shown["position"]) == ("deg", "rpm", "-")


def test_commands_that_are_allowed_show_as_such(cli, make_file):
    path = make_file("bench.toml", "[modbus.units.valve]\ncommands = true\n")
    rows = csv.DictReader(cli(["registers", str(path), "--csv"]).out.splitlines())
    assert {row["access"] for row in rows if row["table"] == "coils"} == {"rw"}


def test_control_characters_of_a_map_do_not_reach_the_terminal(cli, tmp_path, make_file):
    (tmp_path / "map.toml").write_text(
        '[device]\nprofile = "pressure_404"\nvendor_name = "m"\nproduct_code = "c"\n'
        'revision = "1"\n[input_registers.pressure]\naddress = 0\ntype = "float32"\n'
        'source = "pressure"\ndescription = "bar \\u009b2J"\n'
    )
    path = make_file("bench.toml", '[modbus.units.pressure_a]\nregisters = "map.toml"\n')
    rows = csv.DictReader(cli(["registers", str(path), "--csv"]).out.splitlines())
    assert [row["description"] for row in rows] == ["bar \\x9b2J"]


def test_a_wrong_file_is_2(cli, make_file):
    path = make_file("bench.toml", "[modbus]\nport = -1\n")
    assert cli(["registers", str(path)], 2).err == (
        f"hil-bench: error: {path}:modbus.port: -1 is out of range; "
        "give an integer from 0 to 65535\n"
    )


def test_check_finds_a_map_that_does_not_fit_its_device(capsys, tmp_path, make_file):
    (tmp_path / "map.toml").write_text(
        '[device]\nprofile = "encoder_406"\nvendor_name = "m"\nproduct_code = "c"\n'
        'revision = "1"\n[coils.x]\naddress = 0\nsource = "pressures"\n'
    )
    path = make_file("bench.toml", '[modbus.units.position]\nregisters = "map.toml"\n')
    assert main(["check", str(path)]) == 2
    assert '"pressures" is unknown; give an object or one of "position"' in capsys.readouterr().err


def test_lock_step_leaves_no_time_for_modbus(capsys):
    assert main(["run", "-i", "virtual", "-c", "x", "--lockstep", "--modbus"]) == 2
    assert "Modbus clients ask in real time" in capsys.readouterr().err
