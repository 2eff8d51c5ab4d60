"""What verbs print at their end: lines, JSON, or nothing."""

import argparse
import json
import math
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from hil_bench.cli import main
from hil_bench.cli.parser import own_verbs
from hil_bench.cli.results import ecu_text, print_results


class Pair(NamedTuple):
    first: float
    path: Path


def options(**chosen):
    return argparse.Namespace(**{"json": False, "quiet": False} | chosen)


def test_people_get_lines_and_programs_json(capsys):
    content = {"pair": Pair(math.nan, Path("a")), "set": (1, "x", None, True)}
    print_results(options(), ["a line"], content)
    assert capsys.readouterr().out == "a line\n"
    print_results(options(json=True), ["a line"], content)
    # JSON has no NaN (RFC 8259): no value.
    expected = {"pair": {"first": None, "path": "a"}, "set": [1, "x", None, True]}
    # Two blanks a level.
    assert capsys.readouterr().out == json.dumps(expected, indent="  ") + "\n"
    print_results(options(quiet=True), ["a line"], content)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "claimed, address 17"),
        ({"state": "cannot claim"}, "cannot claim"),
        ({"codes": [[1907, 9], [84, 2]]}, "claimed, address 17, SPN 1907 FMI 9, SPN 84 FMI 2"),
    ],
)
def test_a_device_of_j1939_in_words(more, said):
    assert ecu_text({"state": "claimed", "address": 17, "codes": [], **more}) == said


def test_json_has_escapes_of_what_no_terminal_shows(capsys):
    """U+009E begins a message to a terminal; a letter of its own stays. The value is the same."""
    content = {"id": "\x9e\u0085\U000fb642 \u00fc"}
    print_results(options(json=True), [], content)
    printed = capsys.readouterr().out
    assert '"\\u009e\\u0085\\udbad\\ude42 \u00fc"' in printed
    assert json.loads(printed) == content


def test_what_a_file_put_into_a_line_reaches_no_terminal(capsys):
    print_results(options(), ["a\x1b[2J\tb\x8b", "two\nlines: \u00fc"], {})
    assert capsys.readouterr().out == "a\\x1b[2J\\tb\\x8b\ntwo\nlines: \u00fc\n"


@pytest.mark.long
def test_a_demo_for_a_program(tmp_path, cli):
    words = ["demo", "--speed", "max", "--duration", "1", "--output", str(tmp_path)]
    found = json.loads(cli([*words, "--json"]).out)
    assert found["motion"]["bench_time"] == 1.0
    assert Path(found["files"]["recording"]).is_file()
    assert cli([*words, "-q"]).out == ""


def test_a_picture_for_a_program(tmp_path, make_file, capsys):
    log = make_file("bus.log", "(0.1) can0 181#0102\n(0.2) can0 080#\n")
    assert main(["plot", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"picture": str(tmp_path / "bus.png")}


def test_a_commissioning_for_a_program(tmp_path, make_file, cli):
    plan = make_file(
        "plan.toml",
        "[limits]\nposition_mm = [-150, 150]\nspeed_mm_s = 400\npressure_bar = [-1, 110]\n"
        "[communication]\n",
    )
    words = ["commission", str(plan), "--virtual", "--output", str(tmp_path)]
    found = json.loads(cli([*words, "--json"]).out)
    assert found["verdict"] == "passed"
    assert [step["step"] for step in found["steps"]] == ["communication"]
    # The built-in bench has four nodes.
    assert found["steps"][0]["measures"][0]["value"] == 4.0


def completions(tmp_path, *words):
    script = tmp_path / "completion.bash"
    position = len(words) - 1
    script.write_text(
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={position}; _shtab_hil_bench\n"
        'echo "${COMPREPLY[@]}"\n'
    )
    command = f"source {tmp_path}/script.bash; source {script}"
    shell = ["bash", "-c", command]
    done = subprocess.run(shell, capture_output=True, text=True, check=True)  # noqa: S603 - our own
    return done.stdout.split()


def test_a_shell_completes_verbs_and_options(tmp_path, capsys):
    assert main(["completion", "bash"]) == 0
    (tmp_path / "script.bash").write_text(capsys.readouterr().out)
    assert completions(tmp_path, "hil-bench", "ide") == ["identify"]
    assert completions(tmp_path, "hil-bench", "run", "--lock") == ["--lockstep"]
    assert set(completions(tmp_path, "hil-bench", '""')) == own_verbs().keys()


def test_another_shell_is_refused(cli):
    assert "'fish' is unknown; bash, zsh, tcsh are right" in cli("completion fish", 2).err


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells(shell, cli):
    assert "hil-bench" in cli(["completion", shell]).out
