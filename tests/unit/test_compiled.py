import ast
import hashlib
import importlib.util
import json
import logging
import tomllib
from pathlib import Path

import pytest

from hil_bench.bench import compiled
from hil_bench.bench.compiled import look_at_core, warn_of_edits
from hil_bench.cli import main

ROOT = Path(__file__).parents[2]
COMPILED = "agenda.cpython-311-x86_64-linux-gnu.so"


@pytest.fixture
def package(tmp_path):
    """An installation of two modules, as the hook of the build records it."""
    folder = tmp_path / "hil_bench"
    folder.mkdir()
    digests = {}
    for name in ("one.py", "two.py"):
        (folder / name).write_text(f"# {name}\n")
        digests[f"hil_bench/{name}"] = hashlib.sha256(f"# {name}\n".encode()).hexdigest()
    record = {"mypyc": "2.4.1", "modules": digests}
    (folder / "compiled.json").write_text(json.dumps(record))
    return folder


def test_a_compiled_core_says_by_what(package):
    assert str(look_at_core(package, COMPILED)) == "2 modules compiled by mypyc 2.4.1"


def test_an_edited_source_is_named(package):
    (package / "two.py").write_text("# edited\n")

    core = look_at_core(package, COMPILED)

    assert core.edited == ("hil_bench/two.py",)
    assert str(core).endswith("; edited since, without effect: hil_bench/two.py")


def test_a_source_that_is_gone_is_named(package):
    (package / "one.py").unlink()

    assert look_at_core(package, COMPILED).edited == ("hil_bench/one.py",)


def test_another_python_runs_the_sources_whatever_the_wheel_carries(package):
    (package / "two.py").write_text("# edited\n")

    assert str(look_at_core(package, "agenda.py")) == "interpreted"


@pytest.mark.parametrize("text", ["", "[]", '{"mypyc": 1}', '{"mypyc": "2", "modules": 3}'])
def test_a_damaged_record_is_no_failure(package, text):
    (package / "compiled.json").write_text(text)

    assert str(look_at_core(package, COMPILED)) == "0 modules compiled by mypyc"


def test_an_edit_is_said_once(package, monkeypatch, caplog):
    (package / "two.py").write_text("# edited\n")
    edited = look_at_core(package, COMPILED)
    monkeypatch.setattr(compiled, "look_at_core", lambda: edited)
    warn_of_edits.cache_clear()
    with caplog.at_level(logging.WARNING):
        warn_of_edits()
        warn_of_edits()
    warn_of_edits.cache_clear()

    (record,) = caplog.records
    assert record.getMessage() == (
        "hil_bench/two.py was edited after it was compiled, and the edit has no effect; install "
        "again, or work in a checkout (pip install -e .), which runs as it is written"
    )


@pytest.mark.parametrize("words", [["--version", "-v"], ["-v", "--version"]])
def test_the_long_version_says_what_runs(words, capsys):
    assert main(words) == 0

    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[1:3]] == ["core of the bench", "plant kernel"]


def settings():
    with (ROOT / "pyproject.toml").open("rb") as file:
        wheel = tomllib.load(file)["tool"]["hatch"]["build"]["targets"]["wheel"]
    return wheel["hooks"]["custom"]


@pytest.fixture(scope="module")
def hook():
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Warnings:
    def __init__(self):
        self.texts = []

    def display_warning(self, text):
        self.texts.append(text)


def build(hook, version="standard"):
    app, data = Warnings(), {"force_include": {}, "pure_python": True, "infer_tag": False}
    builder = hook.CompiledCore(str(ROOT), settings(), None, None, "", "wheel", app)
    builder.initialize(version, data)
    builder.finalize(version, data, "")
    return data, app.texts


def test_nothing_is_compiled_unless_it_is_asked_for(hook, monkeypatch):
    monkeypatch.delenv("HIL_BENCH_COMPILE", raising=False)

    assert build(hook) == ({"force_include": {}, "pure_python": True, "infer_tag": False}, [])


def test_an_editable_installation_stays_as_it_is_written(hook, monkeypatch):
    monkeypatch.setenv("HIL_BENCH_COMPILE", "1")

    assert build(hook, "editable")[0]["force_include"] == {}


def test_without_a_compiler_the_wheel_is_pure_python(hook, monkeypatch):
    def refuse(*_):
        raise hook.Problem("command 'cc' failed")

    monkeypatch.setenv("HIL_BENCH_COMPILE", "1")
    monkeypatch.setattr(hook, "compile_modules", refuse)

    data, warnings = build(hook)

    assert data == {"force_include": {}, "pure_python": True, "infer_tag": False}
    assert warnings == ["the core is not compiled: command 'cc' failed; it runs as Python"]


def test_what_is_compiled_goes_into_a_wheel_of_this_python(hook, monkeypatch):
    def compile_one(_root, _names, built):
        (built / "lib" / "hil_bench").mkdir(parents=True)
        (built / "lib" / "hil_bench" / "frame.so").touch()

    monkeypatch.setenv("HIL_BENCH_COMPILE", "1")
    monkeypatch.setattr(hook, "compile_modules", compile_one)

    data, _ = build(hook)

    assert sorted(data["force_include"].values()) == [
        "hil_bench/compiled.json",
        "hil_bench/frame.so",
    ]
    assert (data["pure_python"], data["infer_tag"]) == (False, True)


def test_the_record_has_the_digest_of_each_source(hook, tmp_path, monkeypatch):
    monkeypatch.setattr(hook.importlib.metadata, "version", lambda _name: "2.4.1")
    (tmp_path / "empty.py").touch()

    # SHA-256 of nothing, FIPS 180-4.
    digest = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    assert hook.record_of(tmp_path, ["empty.py"]) == {
        "mypyc": "2.4.1",
        "modules": {"empty.py": digest},
    }


@pytest.mark.parametrize("key", ["modules", "uncompiled"])
def test_each_pattern_names_a_file(key):
    assert [glob for glob in settings()[key] if not any(ROOT.glob(glob))] == []


@pytest.mark.long
def test_no_class_that_stays_python_derives_from_one_that_is_compiled():
    """Python refuses that of a compiled class when the module is imported."""
    names = {
        key: {path for glob in settings()[key] for path in ROOT.glob(glob)} for key in settings()
    }
    machine_code = names["modules"] - names["uncompiled"]
    trees = {path: ast.parse(path.read_text("utf-8")) for path in ROOT.glob("hil_bench/**/*.py")}
    places = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in trees}
    native = {
        f"{places[path]}.{node.name}"
        for path in machine_code
        for node in ast.walk(trees[path])
        if isinstance(node, ast.ClassDef)
    }
    derived = []
    for path in trees.keys() - machine_code:
        nodes = list(ast.walk(trees[path]))
        imported = {
            alias.asname or alias.name: f"{node.module}.{alias.name}"
            for node in nodes
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        derived += [
            f"{places[path]}.{node.name}"
            for node in nodes
            if isinstance(node, ast.ClassDef)
            for base in node.bases
            if imported.get(ast.unparse(base)) in native
        ]

    assert derived == []
