"""Every command that the documents and the helps show is one that the program takes."""

import argparse
import contextlib
import functools
import io
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import can
import pytest
from support import documents
from support.ci_recipes import RECIPES
from support.documents import ROOT, Command

from hil_bench import RecordingWish, VirtualBench, cli
from hil_bench.cli.parser import own_verbs

VERBS = own_verbs()
COMMANDS = [*documents.commands("hil-bench"), *documents.remarks("hil-bench")]
OFFLINE = [
    command
    for command in COMMANDS
    if (command.words[1] in {"check", "check-eds", "devices", "registers", "plot"})
    or (command.words[1] in {"replay", "scan"} and "--virtual" in command.words)
    if not {"-i", "--bus"} & {*command.words}
    # What is to be installed first, tests/unit/kinds/test_third_party.py installs and runs.
    if not any(word.startswith("examples/plugin") for word in command.words)
]
PYTHON_PROGRAMS = [
    *documents.commands("python"),
    *documents.remarks("python"),
    *(
        Command(place, tuple(shlex.split(code)))
        for place, code in documents.inline_code()
        if code.startswith("python ")
    ),
]


def parser_of(*words):
    """Return the parser of what the first words name: all, a verb, an analysis of a verb."""
    parser = cli.build_parser(words, VERBS)
    for word in words:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction) and word in action.choices:
                parser = action.choices[word]
    return parser


def refusal_of(words):
    """Return the refusal of arguments that the program does not take; empty if it takes them."""
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.suppress(SystemExit):
        cli.build_parser(words, VERBS).parse_args(words)
    return said.getvalue()


def test_each_command_in_a_block_is_taken():
    said = {str(command): refusal_of(command.words[1:]) for command in COMMANDS}
    assert len(said) > 150
    assert {command: refusal for command, refusal in said.items() if refusal} == {}


def analyses_of(verb):
    """Return the names behind a verb that have helps of their own."""
    for action in parser_of(verb)._actions:
        if isinstance(action, argparse._SubParsersAction):
            return list(action.choices)
    return []


ANALYSES = [f"analyse {name}" for name in analyses_of("analyse")]


def test_the_examples_of_each_help_are_taken():
    for verb in ("", *VERBS, *ANALYSES):
        shown = parser_of(*verb.split()).epilog.partition("examples:\n")[2]
        examples = [
            words[1:]
            for line in re.findall(r"^  (hil-bench .*)$", shown, re.MULTILINE)
            for words in documents.split(re.split(r" {3,}", line)[0])  # then stands what it does
            if words[0] == "hil-bench" and "--help" not in words
        ]
        assert examples, verb
        assert {refusal_of(words) for words in examples} == {""}


def test_each_command_in_the_text_names_a_verb_and_its_options():
    wrong = []
    for place, code in documents.inline_code():
        program, _, words = code.partition(" ")
        verb, *words = words.split() or ["--help"]
        if program != "hil-bench" or verb == "VERB" or verb.startswith("--"):
            continue
        known = parser_of(verb, *words)._option_string_actions if verb in VERBS else {}
        if verb not in VERBS or any(w.startswith("-") and w not in known for w in words):
            wrong.append((place, code))
    assert wrong == []


def test_the_readme_names_every_verb():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [verb for verb in VERBS if f"hil-bench {verb}" not in text] == []


@pytest.fixture(scope="module")
def files_of_a_user(tmp_path_factory):
    """A folder with the files that the documents name."""
    folder = tmp_path_factory.mktemp("user")
    recordings = [folder / name for name in ("run.mf4", "run.csv", "bus.log")]
    with VirtualBench(record=RecordingWish(tuple(recordings))) as bench:
        bench.run(0.01)  # the nodes boot
        bench.bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
        bench.run(1.2)
    for name, source in {
        "bench.toml": "examples/one_axis.toml",
        "vendor.eds": "device_profiles/imitations/analogue_io_401.eds",
    }.items():
        (folder / name).write_bytes((ROOT / source).read_bytes())
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


@pytest.mark.parametrize("command", OFFLINE, ids=str)
def test_a_command_that_needs_no_bus_runs(command, files_of_a_user, monkeypatch, capsys):
    monkeypatch.chdir(files_of_a_user)
    assert cli.main(command.words[1:]) == 0, capsys.readouterr().err


def test_each_python_program_is_there_and_has_the_options():
    assert len(PYTHON_PROGRAMS) > 80
    for command in PYTHON_PROGRAMS:
        *_, last = (number for number, word in enumerate(command.words) if word.endswith(".py"))
        program, *words = command.words[last:]
        folder = ROOT / Path(command.place).parent
        (path,) = (path for path in {ROOT / program, folder / program} if path.exists())
        text = path.read_text(encoding="utf-8")
        options = [word for word in words if word.startswith("-")]
        if any(f'"{option}"' not in text for option in options):
            text = help_of(path)
        assert [option for option in options if option not in text] == [], command


@functools.cache
def help_of(program):
    """Return the help of a program."""
    call = [sys.executable, program, "--help"]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout  # noqa: S603


def test_every_option_of_the_plugin_that_is_named_is_there(pytestconfig):
    texts = [path.read_text(encoding="utf-8") for path in (*documents.DOCUMENTS, *RECIPES)]
    named = {name for text in texts for name in re.findall(r"--hil-([a-z]+(?:-[a-z]+)*)", text)}
    assert len(named) >= 8
    known = {*vars(pytestconfig.option)}
    assert [name for name in named if f"hil_{name.replace('-', '_')}" not in known] == []


def test_every_extra_that_is_named_is_there():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    sources = [*documents.DOCUMENTS, *RECIPES, *Path(cli.__file__).parents[1].rglob("*.py")]
    texts = [path.read_text(encoding="utf-8") for path in sources]
    named = {
        extra
        for text in texts
        for extras in re.findall(r"'(?:hil-bench|\.)\[([a-z,]+)\]'", text)
        for extra in extras.split(",")
    }
    assert {"analysis", "modbus", "plot", "test"} <= named <= {*project["optional-dependencies"]}
