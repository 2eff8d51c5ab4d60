"""`hil-bench program` on the virtual bench."""

import json
from pathlib import Path

import pytest

from hil_bench.abilities.common import progress
from hil_bench.cli import main
from hil_drivers.program import ProgramDownload, ProgramState

BENCH = str(Path(__file__).parents[3] / "examples" / "program_download.toml")
NODE = ["program", BENCH, "--virtual", "--node", "10"]


@pytest.fixture
def program(make_file):
    path = make_file("firmware.bin", b"123456789")
    return str(path)


def test_without_a_file_it_shows_what_is_there(cli):
    assert cli(NODE).out.splitlines() == [
        "program         running",
        "identification  0x00010000",
        "flash           no error",
    ]


@pytest.mark.parametrize("options", [[], ["--segmented"]])
def test_a_file_is_downloaded(capsys, program, options):
    assert main([*NODE, "--file", program, *options, "--json"]) == 0
    # The check value of CRC-32.
    assert json.loads(capsys.readouterr().out)["state"]["identification"] == 0xCBF43926


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        (["--virtual", "--node", "1"], 1, "node 1: has no program 1; a device with 0x1F50"),
        (["--virtual", "--node", "9"], 6, "node 9: no answer within 2 s"),
        (["--virtual", "--node", "128"], 2, "--node 128: a number from 1 to 127 is right"),
        (["--virtual", "--node", "1", "--file", "none"], 2, "--file none: cannot be read: No such"),
    ],
)
def test_what_is_wrong_is_a_line(cli, arguments, code, what):
    (line,) = cli(["program", *arguments], code).err.splitlines()
    assert what in line


@pytest.mark.parametrize(
    ("state", "options", "code", "what"),
    [
        (ProgramState(False, 1, 0), [], 1, "0x1F51 says that it is stopped"),
        (ProgramState(False, 1, 0), ["--no-start"], 0, ""),
        (ProgramState(None, 1, 0), [], 6, "0x1F51 does not say that the program runs"),
        (ProgramState(True, 1, 1), [], 6, "0x1F57 says that the device flashes or clears"),
    ],
)
def test_a_program_that_is_not_seen_to_run_is_no_update(
    monkeypatch, cli, program, state, options, code, what
):
    monkeypatch.setattr(ProgramDownload, "update", lambda *_args, **_options: state)
    shown = cli([*NODE, "--file", program, *options], code)
    assert what in shown.err
    assert bool(shown.err) is bool(what)


def test_a_long_download_says_how_far_it_is(monkeypatch, cli, program):
    monkeypatch.setattr(progress, "WORK_PERIOD", 0)
    monkeypatch.setattr(progress, "_LOOK_S", 0.001)
    assert "9 of 9 bytes" in cli([*NODE, "--file", program]).err


def test_wrong_keys_of_the_memory_are_named(capsys, tmp_path):
    path = tmp_path / "bench.toml"
    text = Path(BENCH).read_text(encoding="utf-8").replace("write_ms", "write_s")
    eds = Path(BENCH).parent / "../device_profiles"
    path.write_text(text.replace("../device_profiles", str(eds)), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert "write_s: unknown key; the nearest known key is write_ms" in capsys.readouterr().err
