"""Programs and libraries as files: what is seen before a run."""

import shutil
import stat
import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.programs import needs_compiler, surroundings_of

from hil_bench.abilities.controllers.program import preload
from hil_bench.abilities.controllers.program.controller import interface_names
from hil_bench.abilities.controllers.program.exchange import RING, Exchange
from hil_bench.abilities.controllers.program.kind import KIND, find_fault
from hil_bench.config.settings import Given, Origin, Problems, convert, read_table
from hil_bench.errors import ConfigError, ControllerError, ControllerFileError

X86_64, AARCH64, PT_LOAD, PT_INTERP = 62, 183, 1, 3


def elf(machine=X86_64, interpreter=b"/lib64/ld-linux-x86-64.so.2\0", bits=2):
    """The head of a program (System V ABI, ELF-64): one segment, and an interpreter's name."""
    kind = PT_INTERP if interpreter else PT_LOAD
    begin = 64 + 56
    head = b"\x7fELF" + bytes([bits, 1, 1]) + bytes(9)
    head += struct.pack("<HHIQQQIHHHHHH", 3, machine, 1, 0, 64, 0, 0, 64, 56, 1, 0, 0, 0)
    size = len(interpreter)
    return head + struct.pack("<IIQQQQQQ", kind, 4, begin, 0, 0, size, size, 1) + interpreter


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.setattr("platform.machine", lambda: "x86_64")

    def write(content, mode=0o755, name="firmware"):
        path = tmp_path / name
        path.write_bytes(content)
        path.chmod(mode)
        return str(path)

    return write


def test_a_program_of_this_machine_has_no_fault(write):
    assert find_fault(write(elf())) == ""


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (elf(interpreter=b""), "is linked statically, so that no library can be preloaded"),
        (elf(interpreter=b"/lib/ld-musl-x86_64.so.1\0"), "is linked with musl; glibc is right"),
        (elf(machine=AARCH64), "is for another processor; a program for x86_64 is right"),
        (elf(bits=1), "is for another processor; a program for x86_64 is right"),
        (b"MZ\x90", "is no program of Linux (ELF)"),
        (b"", "is no program of Linux (ELF)"),
        (b"\x7fELF\x02\x01", "is cut off"),
        (elf()[:100], "is cut off"),
    ],
)
def test_what_no_library_can_be_preloaded_into(write, content, fault):
    path = write(content)
    assert fault in find_fault(path)
    settings = {"command": (path,), "time": "bench", "cpu_s_per_tick": 5.0}
    [line] = KIND.problems(settings, None)
    assert line.startswith(f"command: {path}: ")


def test_a_setuid_program_of_another_user(write, monkeypatch):
    path = write(elf(), stat.S_ISUID | 0o755)
    monkeypatch.setattr("os.geteuid", lambda: 4711)
    assert "is setuid or setgid" in find_fault(path)


def test_a_script_is_judged_by_its_interpreter(write, tmp_path, monkeypatch):
    static = write(elf(interpreter=b""), name="shell")
    assert "shell: is linked statically" in find_fault(write(f"#!{static} -e\n".encode()))
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert "shell: is linked statically" in find_fault(write(b"#!/usr/bin/env shell\n"))
    assert find_fault(write(b"#!\n")) == ""  # the start says what is wrong
    loop = tmp_path / "firmware"
    assert find_fault(write(f"#!{loop}\n".encode())) == ""


def test_a_program_that_is_not_there_is_left_to_the_start(tmp_path):
    assert find_fault(str(tmp_path / "nothing")) == ""


@needs_compiler
def test_the_start_says_that_a_program_is_not_there(tmp_path):
    settings = {"command": ("no-such-program",), "time": "bench", "cpu_s_per_tick": 5.0}
    controller = KIND.build(settings, surroundings_of(tmp_path))
    with pytest.raises(ControllerError, match=r"^no-such-program: cannot be started: No such file"):
        controller.advance(1, ())
    controller.close()


def test_the_build_refuses_what_the_check_refuses(write, tmp_path):
    settings = read(command=[write(elf(interpreter=b""))])
    with pytest.raises(ConfigError, match=r"^\[controller\]\.command: .*firmware: is linked stat"):
        KIND.build(settings, surroundings_of(tmp_path))


def read(**values):
    problems = Problems("bench.toml")
    given = {k: Given(v, Origin.FILE, f"bench.toml:{k}") for k, v in values.items()}
    found = read_table("controller", given, KIND.keys, problems)
    problems.raise_any()
    return convert(found, KIND.keys)


def test_its_keys():
    assert read(command=["a", "{bus}"]) == {
        "command": ("a", "{bus}"),
        "time": "bench",
        "cpu_s_per_tick": 5.0,
    }
    with pytest.raises(ConfigError, match='time: "wall" is unknown; give one of "bench", "real"'):
        read(command=["a"], time="wall")
    [line] = KIND.problems(read(command=[]), None)
    assert line.startswith("command: is empty")


def test_elsewhere_than_on_linux_it_is_refused(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    [line] = KIND.problems(read(command=["a"]), None)
    assert line == "kind: programs run on Linux; take another kind here"


@pytest.fixture
def no_library(tmp_path, monkeypatch):
    """A user who has no library yet, and a package that brings none."""
    monkeypatch.setattr(preload, "INSTALLED", tmp_path / "none.so")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


@needs_compiler
@pytest.mark.long  # compiles the library
def test_the_library_is_compiled_once(no_library):
    library = preload.find_library()
    assert library.parent == no_library / "cache" / "hil-bench"
    before = library.stat().st_mtime_ns
    assert preload.find_library() == library
    assert library.stat().st_mtime_ns == before
    assert list(library.parent.iterdir()) == [library]


def test_a_wheel_brings_the_library(no_library):
    (no_library / "none.so").touch()
    assert preload.find_library() == no_library / "none.so"


def test_without_a_compiler_one_line_says_what_to_do(no_library, monkeypatch):
    monkeypatch.setenv("PATH", str(no_library))
    right = r"install gcc, or a wheel that was built with HIL_BENCH_COMPILE=1$"
    with pytest.raises(
        ConfigError, match=rf'^kind "program": there is no C compiler \(cc\); {right}'
    ):
        preload.find_library()


@pytest.mark.skipif(shutil.which("false") is None, reason="needs false(1)")
@pytest.mark.usefixtures("no_library")
def test_a_compiler_that_refuses_is_named(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ConfigError, match=r"the C compiler refuses: .*false; install gcc"):
        preload.find_library()


@pytest.mark.parametrize(("uid", "mode"), [(4711, 0o755), (None, 0o777), (None, 0o702)])
def test_a_library_that_another_user_may_have_put_there_is_not_loaded(
    no_library, monkeypatch, uid, mode
):
    folder = no_library / "cache" / "hil-bench"
    folder.mkdir(parents=True)
    folder.chmod(mode)
    (folder / f"program-{preload._digest()}.so").touch()
    owner = folder.stat()
    found = SimpleNamespace(st_uid=owner.st_uid if uid is None else uid, st_mode=owner.st_mode)
    stat = Path.stat
    monkeypatch.setattr(
        Path, "stat", lambda path, **more: found if path == folder else stat(path, **more)
    )
    with pytest.raises(ConfigError, match=r"other users may write in .*; set XDG_CACHE_HOME to"):
        preload.find_library()


@pytest.mark.usefixtures("no_library", "no_home")
def test_a_user_without_a_home_hears_what_to_set(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME")
    with pytest.raises(ConfigError, match=r"no home directory .*; set XDG_CACHE_HOME to a folder"):
        preload.find_library()


def test_a_cache_that_cannot_be_used_is_no_failed_controller(no_library):
    """`test` ends with 2 at it, as at a controller's file that is missing."""
    (no_library / "cache").write_text("a file")
    with pytest.raises(ControllerFileError, match="cache/hil-bench: cannot be written: Not a dir"):
        preload.find_library()


def test_a_path_that_ld_preload_cannot_hold(no_library, monkeypatch):
    library = no_library / "a b" / "x.so"
    library.parent.mkdir()
    library.touch()
    monkeypatch.setattr(preload, "INSTALLED", library)
    with pytest.raises(ConfigError, match="a path with a blank or colon cannot be preloaded"):
        preload.find_library()


def test_the_memory_is_as_the_library_has_it():
    """The offsets are those that `bench.h` asserts; RING and VERSION stand in both."""
    header = (preload.SOURCES / "bench.h").read_text(encoding="utf-8")
    assert f"#define RING {RING} " in header
    exchange = Exchange(["can0"], 5)
    try:
        assert not exchange.is_attached
        assert exchange.take() == []
    finally:
        exchange.close()


def test_interfaces_are_named_as_the_buses():
    assert interface_names(["bus", "front", "a_name_beyond_15"]) == ["can0", "front", "can2"]
