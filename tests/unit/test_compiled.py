import ast
import hashlib
import importlib.util
import json
import logging
import re
import tomllib
from pathlib import Path

import pytest
from support.dissection import require_tool

from hil_bench.bench import compiled
from hil_bench.bench.compiled import look_at_core, warn_of_edits

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
def test_the_long_version_says_what_runs(words, cli):
    lines = cli(words).out.splitlines()
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
    for part in PARTS:
        monkeypatch.setattr(hook, part, refuse)

    data, warnings = build(hook)

    assert data == {"force_include": {}, "pure_python": True, "infer_tag": False}
    assert warnings == [
        "the core is not compiled: command 'cc' failed; it runs as Python",
        "the plant's kernels are not compiled: command 'cc' failed; Numba does it at run time",
        "calls are not compiled: command 'cc' failed; ctypes or a first run does it",
        "the library of programs is not compiled: command 'cc' failed; a first run does it",
    ]


CORE, KERNELS = "hil_bench/frame.so", "hil_bench/plants/_kernels.so"
PRELOAD = "hil_bench/abilities/controllers/program/_preload.so"
CALLS = "hil_bench/abilities/controllers/library/_call.so"
PARTS = {
    "compile_modules": CORE,
    "compile_kernels": KERNELS,
    "compile_calls": CALLS,
    "compile_preload": PRELOAD,
}


def compile_one(name):
    """What compiles in place of a compiler: one module."""

    def compile_it(_root, *others):
        file = others[-1] / "lib" / name
        file.parent.mkdir(parents=True)
        file.touch()

    return compile_it


def test_what_is_compiled_goes_into_a_wheel_of_this_python(hook, monkeypatch):
    monkeypatch.setenv("HIL_BENCH_COMPILE", "1")
    for part, name in PARTS.items():
        monkeypatch.setattr(hook, part, compile_one(name))

    data, _ = build(hook)

    included = ["hil_bench/compiled.json", *PARTS.values()]
    assert sorted(data["force_include"].values()) == sorted(included)
    assert (data["pure_python"], data["infer_tag"]) == (False, True)


@pytest.mark.parametrize("broken", PARTS)
def test_a_wheel_has_what_could_be_compiled(hook, monkeypatch, broken):
    def refuse(*_):
        raise hook.Problem("refused")

    monkeypatch.setenv("HIL_BENCH_COMPILE", "1")
    for part, name in PARTS.items():
        monkeypatch.setattr(hook, part, compile_one(name))
    monkeypatch.setattr(hook, broken, refuse)

    data, warnings = build(hook)

    included = {name for part, name in PARTS.items() if part != broken}
    if broken != "compile_modules":
        included.add("hil_bench/compiled.json")  # of which sources
    assert set(data["force_include"].values()) == included
    assert len(warnings) == 1
    assert data["infer_tag"]


def test_kernels_are_made_for_x86_64_only(hook, monkeypatch, tmp_path):
    monkeypatch.setattr(hook.platform, "machine", lambda: "aarch64")

    with pytest.raises(hook.Problem, match="for x86-64 only, and this is aarch64"):
        hook.compile_kernels(ROOT, tmp_path / "kernels")


def test_without_numba_no_kernels_are_compiled(hook, monkeypatch, tmp_path):
    monkeypatch.setattr(hook.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(hook.importlib.util, "find_spec", lambda _name: None)

    with pytest.raises(hook.Problem, match="there is no Numba"):
        hook.compile_kernels(ROOT, tmp_path / "kernels")


def test_a_compiler_of_kernels_that_fails_is_named(hook, monkeypatch, tmp_path):
    """As with a Numba whose inner functions have other names: its last line says it."""
    (tmp_path / "kernels").mkdir()
    program = "import sys; print('Traceback', file=sys.stderr); sys.exit('no such flag')"
    (tmp_path / "kernels" / "compile.py").write_text(program)
    monkeypatch.setattr(hook.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(hook.importlib.util, "find_spec", lambda _name: True)

    with pytest.raises(hook.Problem, match=r"^Numba refuses: no such flag$"):
        hook.compile_kernels(tmp_path, tmp_path / "built")


def test_the_library_for_programs_is_made_by_the_package_itself(hook, tmp_path):
    require_tool("cc", "gcc")
    hook.compile_preload(ROOT, tmp_path)
    [library] = tmp_path.rglob("*.so")
    assert str(library.relative_to(tmp_path / "lib")) == PRELOAD
    assert library.read_bytes().startswith(b"\x7fELF")


def test_without_a_compiler_there_is_no_library_for_programs(hook, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(hook.Problem, match=r"^there is no C compiler \(cc\)$"):
        hook.compile_preload(ROOT, tmp_path)


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


def test_no_class_that_stays_python_derives_from_one_that_is_compiled():
    """Python refuses that of a compiled class when the module is imported."""
    names = {
        key: {path for glob in settings()[key] for path in ROOT.glob(glob)} for key in settings()
    }
    machine_code = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path
        for path in names["modules"] - names["uncompiled"]
    }
    native = {
        f"{name}.{node.name}"
        for name, path in machine_code.items()
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    derived = []
    for path in {*ROOT.glob("hil_bench/**/*.py")} - {*machine_code.values()}:
        text = path.read_text("utf-8")
        known = machine_code.keys() & re.findall(r"^ *from (\S+) import", text, re.MULTILINE)
        if not known or not re.search(r"^ *class \w+\(", text, re.MULTILINE):
            continue  # without the time that it takes to parse all
        nodes = list(ast.walk(ast.parse(text)))
        imported = {
            alias.asname or alias.name: f"{node.module}.{alias.name}"
            for node in nodes
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        derived += [
            f"{path}: {node.name}"
            for node in nodes
            if isinstance(node, ast.ClassDef)
            for base in node.bases
            if imported.get(ast.unparse(base).partition("[")[0]) in native
        ]

    assert derived == []
