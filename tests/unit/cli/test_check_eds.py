"""`hil-bench check-eds`."""

import json

from device_profiles import ENCODER_406, VALVE_408
from hil_bench.cli import main


def test_clean_files_are_told_so(capsys):
    assert main(["check-eds", str(VALVE_408), str(ENCODER_406)]) == 0
    assert capsys.readouterr().out == f"{VALVE_408}: ok\n{ENCODER_406}: ok\n"


def test_findings_have_file_and_line(make_file, capsys, cli):
    path = make_file("broken.eds", VALVE_408.read_text().replace("EDSVersion=4.0", "EDSVersion=9"))
    assert cli(["check-eds", str(path)]).out.splitlines() == [
        f"{path}:5: warning: [FileInfo] EDSVersion: is 9; 4.0 is right",
        f"{path}: no errors; 1 warning",
    ]
    assert main(["check-eds", "--strict", str(path)]) == 1
    capsys.readouterr()
    (finding,) = json.loads(cli(["check-eds", "--json", str(path)]).out)[str(path)]
    assert (finding["line"], finding["section"]) == (5, "FileInfo")
    assert finding["severity"] == "warning"


def test_what_will_not_work_is_an_error(make_file, cli):
    path = make_file("broken.eds", VALVE_408.read_text().replace("0x60400010", "0x60400020"))
    error, summary = cli(["check-eds", str(path)], 1).out.splitlines()
    assert "error: [1600sub1] DefaultValue: maps 0x6040.00 (32 bit)" in error
    assert error.endswith("; RPDO1 is off")
    assert summary == f"{path}: 1 error; no warnings"


def test_a_file_that_is_no_eds_is_an_error(make_file, cli):
    path = make_file("other.eds", "[FileInfo]\n")
    error, summary = cli(["check-eds", str(path)], 1).out.splitlines()
    assert error.startswith(f"{path}:1: error: [] is no EDS file, it has no object such as [1000]")
    assert summary == f"{path}: 1 error; no warnings"


def test_a_missing_file_is_a_usage_error(tmp_path, capsys):
    assert main(["check-eds", str(tmp_path / "none.eds")]) == 2
    assert "none.eds: No such file or directory; name an EDS" in capsys.readouterr().err
