"""`hil-bench shadow` on the recorded frames of a machine."""

import json

import pytest

from hil_bench.cli import main
from hil_bench.recording.files import read_recording
from hil_bench.virtual_bench import VirtualBench


@pytest.fixture
def log(tmp_path, capsys):
    """Return a recording of the demo's bus."""
    path = tmp_path / "machine.log"
    output = str(tmp_path / "demo")
    demo = ["demo", "--speed", "max", "--duration", "1.5", "--output", output, "-q"]
    assert main([*demo, "--record", str(path)]) == 0
    capsys.readouterr()
    return path


def test_windows_are_told_and_the_worst_at_the_end(log, capsys):
    assert main(["shadow", "--log", str(log)]) == 0
    out = capsys.readouterr().out
    assert "axis1  position" in out
    assert "windows, 0 of them beyond a limit; the worst:" in out
    assert "limit 1.000 mm: ok" in out


def test_a_limit_that_is_passed_is_exit_code_1(log, capsys):
    limits = ["--position-mm", "0.000001", "--horizon", "0.2"]
    assert main(["shadow", "--log", str(log), *limits]) == 1
    out = capsys.readouterr().out
    assert "limit 0.000 mm: TOO MUCH" in out
    assert " mm !" in out


def test_json_and_a_recording_of_both_sides(log, tmp_path, capsys):
    csv = tmp_path / "residuals.csv"
    assert main(["shadow", "--log", str(log), "--json", "--record", str(csv)]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["exceeded"] == 0
    assert set(content["worst"]["axis1"]) == {"position", "P_A", "P_B", "spool_position"}
    names = read_recording(csv).dtype.names
    assert names[0] == "time"
    assert {"axis1.position", "axis1.position_twin", "axis1.P_A_twin"} <= set(names)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--horizon", "0"], "--horizon 0: more than 0 is right"),
        (["--record", "r.mf4"], "--record r.mf4: give a file name that ends in .csv"),
        (["--horizon", "100"], "--horizon 100: 0.02 to 60 s is right"),
        (["--position-mm", "nan"], "--position-mm nan: more than 0 is right"),
        (["--log", "x.log", "-i", "virtual"], "--log needs no bus; give either --log or -i and -c"),
        (["--log", "absent.log"], "absent.log: cannot be read: No such file or directory"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(arguments, message, capsys):
    assert main(["shadow", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_bus_without_the_machine_says_what_is_missing(tmp_path, capsys):
    log = tmp_path / "quiet.log"
    with VirtualBench(record=log) as bench:
        bench.run(0.1)  # boot-ups, and nothing more: the nodes are not started
    assert main(["shadow", "--log", str(log)]) == 1
    assert "nothing to compare: 4 frames heard, but not position and both" in (
        capsys.readouterr().err
    )
