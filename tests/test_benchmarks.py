"""The benchmarks: each has a brief run, and one whose part did not run fails."""

import argparse
import importlib.util
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


def load(name):
    """A module of the folder, which is no package."""
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


brief, occasion = load("brief"), load("occasion")


def test_each_benchmark_takes_brief():
    texts = {name: (FOLDER / f"{name}.py").read_text(encoding="utf-8") for name in brief.programs()}
    entries = ("occasion.arguments(", "occasion.print_occasion(")
    assert [name for name, text in texts.items() if not any(each in text for each in entries)] == []


def test_every_other_file_is_a_part_of_one():
    files = {path.stem for path in FOLDER.glob("*.py")}
    assert files - set(brief.programs()) == brief.PARTS


def test_each_area_of_mutation_has_modules_and_its_tests_are_there():
    parts = load("mutation_tests")
    assert {"drivers", "scenario", "plants"} < parts.areas().keys()
    assert all(parts.areas().values())
    tests = [*parts.tests_of_map(as_python=False), *parts.tests_of_map(as_python=True)]
    files = [name.partition("::")[0] for name in tests if name.startswith("tests/")]
    assert files
    assert all((FOLDER.parent / name).exists() for name in files)


@pytest.mark.parametrize(
    ("words", "repeats"), [([], 9), (["--brief"], 1), (["--brief", "--repeats", "4"], 4)]
)
def test_brief_changes_defaults_only(monkeypatch, capsys, words, repeats):
    monkeypatch.setattr(sys, "argv", ["it.py", *words])
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=9)
    assert occasion.arguments(parser, repeats=1).repeats == repeats
    assert ("no figures to quote" in capsys.readouterr().out) == ("--brief" in words)


def test_the_occasion_names_the_commit(monkeypatch, capsys):
    monkeypatch.setattr(occasion, "commit", lambda: "1234567-dirty")
    occasion.print_occasion(argparse.Namespace(brief=False))
    assert "commit 1234567-dirty; " in capsys.readouterr().out


class Ended:
    """A process that has ended with a code."""

    def __init__(self, code):
        self.exitcode = code

    def join(self):
        """Nothing is left to wait for."""


def test_a_part_that_failed_ends_the_benchmark(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["benchmarks/lateness.py"])
    occasion.joined(Ended(0), "the status line")
    with pytest.raises(SystemExit) as caught:
        occasion.joined(Ended(1), "the status line")
    assert caught.value.code == (
        "lateness.py: the status line did not run: its process ended with 1; its traceback is above"
    )


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("print('--brief')", ""),
        ("raise SystemExit(3)", "exit code 3"),
        ("print('| a table |')", "it does not say that it was brief"),
        (
            "import sys\nprint('--brief')\nsys.stderr.write('Traceback (most recent call last):')",
            "a part of it failed",
        ),
    ],
)
def test_a_benchmark_that_did_not_run_fails(tmp_path, monkeypatch, program, reason):
    (tmp_path / "one.py").write_text(program, encoding="utf-8")
    monkeypatch.setattr(brief, "HERE", tmp_path)
    assert brief.run("one").partition("\n")[0] == reason
