"""`hil-bench check-eds`."""

import json

from device_profiles import ENCODER_406, VALVE_408
from hil_bench.cli import main


def test_clean_files_are_told_so(capsys):
    assert main(["check-eds", str(VALVE_408), str(ENCODER_406)]) == 0
    assert capsys.readouterr().out == f"{VALVE_408}: ok\n{ENCODER_406}: ok\n"


def test_findings_have_file_and_line(tmp_path, capsys):
    path = tmp_path / "broken.eds"
    path.write_text(VALVE_408.read_text().replace("EDSVersion=4.0", "EDSVersion=9"))
    assert main(["check-eds", str(path)]) == 1
    out = capsys.readouterr().out
    assert out == f"{path}:5: [FileInfo] EDSVersion: is 9; 4.0 is right\n"
    assert main(["check-eds", "--json", str(path)]) == 1
    (finding,) = json.loads(capsys.readouterr().out)[str(path)]
    assert (finding["line"], finding["section"]) == (5, "FileInfo")


def test_a_missing_file_is_a_usage_error(tmp_path, capsys):
    assert main(["check-eds", str(tmp_path / "none.eds")]) == 2
    assert "cannot be read" in capsys.readouterr().err
