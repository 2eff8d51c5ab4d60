"""Controllers as shared libraries: the six functions, what they say, and what cannot be.

The libraries are a few lines of C, built here; the example of examples/firmware is one of them.
"""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from hil_bench import ControllerEnd, TimedFrame, VirtualBench, load_config
from hil_bench.abilities.controllers import library
from hil_bench.abilities.controllers.library import controller as library_controller
from hil_bench.abilities.controllers.library.controller import LibraryController
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError, ControllerError

ROOT = Path(__file__).parents[3]
ECHO = Path(__file__).with_name("echo.c")
INCLUDE = Path(library.__file__).parent / "include"

pytestmark = pytest.mark.skipif(
    "CI" not in os.environ and not (shutil.which("make") and shutil.which("cc")),
    reason="needs a C compiler and make",
)


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Return what builds the echo with definitions of the preprocessor."""
    folder = tmp_path_factory.mktemp("echo")

    def make(name, *definitions):
        words = ["cc", "-shared", "-fPIC", f"-I{INCLUDE}", "-DVERSION=1", *definitions]
        subprocess.run([*words, ECHO, "-o", folder / name], check=True)
        return folder / name

    return make


@pytest.fixture(scope="module")
def echo(build):
    return build("libecho.so")


@pytest.fixture(scope="module")
def machine_code(tmp_path_factory):
    """Return the module by which a compiled wheel calls libraries, in place of ctypes."""
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        pytest.skip("needs the headers of Python")
    file = tmp_path_factory.mktemp("calls") / "_call.so"
    words = ["cc", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror"]
    words += [f"-I{sysconfig.get_path('include')}", INCLUDE.parent / "_call.c", "-o", file]
    subprocess.run(words, check=True)
    spec = importlib.util.spec_from_file_location("_call", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.advance


@pytest.fixture(params=["ctypes", "machine code"])
def instance(request, echo, monkeypatch):
    way = request.getfixturevalue("machine_code") if request.param == "machine code" else None
    monkeypatch.setattr(library_controller, "_advance", way)
    controller = LibraryController(echo, {"side": "left"})
    assert controller.advance(1, ()) == []
    yield controller
    controller.close()


FRAMES = [
    TimedFrame(5, Frame(0x123, b"\1\2\3")),
    TimedFrame(6, Frame(0x18FEF100, bytes(8), is_extended=True, bus=1)),
    TimedFrame(7, Frame(0x321, is_remote=True)),
]


def test_frames_go_in_and_out_whole(instance):
    instance.advance(1000, ())
    sent = instance.advance(2000, FRAMES)
    expected = [
        TimedFrame(1000 + number, frame._replace(bus=frame.bus ^ 1))
        for number, (_, frame) in enumerate(FRAMES)
    ]
    assert repr(sent) == repr(expected)  # of their types, too


def test_more_frames_than_a_call_has_room_for_come_in_several(instance):
    many = [TimedFrame(k, Frame(k)) for k in range(600)]
    assert [frame.can_id for _, frame in instance.advance(1_000_000, many)] == list(range(600))


def test_what_is_no_frame_is_not_packed(machine_code):
    for frame in ((1, Frame(1, bytes(9))), (1, (1, b"")), None):
        with pytest.raises(TypeError, match="no frame with its time"):
            machine_code(0, 0, 0, [frame], bytearray(24), TimedFrame, Frame)


def test_it_has_begun_when_it_says_so(echo):
    controller = LibraryController(echo, {})
    controller.advance(1, ())
    assert not controller.has_begun
    controller.advance(2, ())
    assert controller.has_begun
    controller.close()
    controller.close()


def test_two_instances_know_nothing_of_each_other(echo):
    first, second = LibraryController(echo, {}), LibraryController(echo, {})
    first.advance(1, ())
    assert second.advance(1, FRAMES) == []  # its first call
    assert len(first.advance(2, FRAMES)) == 3
    first.close()
    second.close()


@pytest.mark.parametrize(
    ("frame", "error", "words"),
    [
        (Frame(0x7FF), ControllerEnd, r"^two$"),
        (Frame(0x7FF, b"x"), ControllerError, r"libecho\.so: has failed: two$"),
        (Frame(0x7FE), ControllerError, r"sent no CAN frame: identifier 0x7FE, length 9, flags 0"),
    ],
)
def test_an_end_and_a_failure_have_words(instance, frame, error, words):
    with pytest.raises(error, match=words):
        instance.advance(2000, [TimedFrame(5, frame)])


def test_a_reset_begins_anew(instance):
    instance.reset()
    assert instance.advance(2000, FRAMES) == []
    assert not instance.has_begun


@pytest.mark.parametrize(
    ("definitions", "words"),
    [
        (["-UVERSION", "-DVERSION=2"], "is of version 2; build it with the hil_controller.h of"),
        (["-DNO_DESTROY"], "lacks hil_controller_destroy; hil_controller.h has all six"),
    ],
)
def test_another_library_is_one_line(build, definitions, words):
    path = build(f"lib{definitions[-1][2:]}.so", *definitions)
    with pytest.raises(ControllerError) as error:
        LibraryController(path, {})
    assert words in str(error.value)


def test_what_is_no_library_is_one_line(tmp_path, echo):
    (tmp_path / "text.so").write_text("no library")
    for path, words in (
        ("none.so", "there is no such library; build it"),
        ("text.so", "cannot be"),
    ):
        with pytest.raises(ControllerError) as error:
            LibraryController(tmp_path / path, {})
        assert words in str(error.value)
        assert "\n" not in str(error.value)
    with pytest.raises(ControllerError, match="makes no instance: side: left is right"):
        LibraryController(echo, {"side": "right"})


LATE = (
    "at {} s the controller did not come back: it took 1 s of processor time; "
    "let it return when it has lived until then, or give patience_s above 1 s"
)

ONE_CALL = """
import sys
from pathlib import Path
from hil_bench.abilities.controllers.library.controller import LibraryController
LibraryController(Path(sys.argv[1]), {}).advance(1, ())
"""


@pytest.mark.parametrize(
    ("definitions", "code", "words"),
    [
        (["-DLEAVES"], 1, "hil-bench: error: a controller's library has called exit()\n"),
        (["-DSTAYS"], 0, ""),
    ],
)
def test_a_library_that_exits_does_not_end_the_run_as_passed(build, definitions, code, words):
    path = build(f"lib{definitions[0][2:]}.so", *definitions)
    ended = subprocess.run(
        [sys.executable, "-c", ONE_CALL, path], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (code, words)


@pytest.mark.long
def test_what_ends_its_process_is_a_verdict_and_the_next_scenario_is_played(build, tmp_path):
    """Two end their process at their first call, one never comes back, the last one prints."""
    leaves = "-DLEAVES"
    ways = {"a": [leaves, "-Dexit=_Exit"], "b": [leaves, "-Dexit(x)=abort()"], "c": ["-DHANGS"]}
    ways["d"] = ["-DPRINTS"]
    head = 'title = "T"\nduration_s = 0.06\n[controller]\nkind = "library"\npatience_s = 1\n'
    expect = '[[expect]]\nid = "R"\nthat = "always axis1.P_A < 250 bar"\n'
    for name, definitions in ways.items():
        library = f'library = "{build(f"ends_{name}.so", *definitions)}"\n'
        (tmp_path / f"{name}.scenario.toml").write_text(head + library + expect)
    words = [sys.executable, "-m", "hil_bench", "test", tmp_path, "--json"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == ExitCode.CHECK_FAILED
    found = json.loads(ended.stdout)
    first, second, third, last = (found[str(tmp_path / f"{name}.scenario.toml")] for name in ways)
    assert first["problem"] == "its process ended with exit code 0"
    assert second["problem"] == "its process was killed (SIGABRT)"
    assert third["problem"] == f"{tmp_path / 'c.scenario.toml'}:controller: {LATE.format('0.050')}"
    assert last["problem"] == ""
    assert last["findings"]
    assert "one line" in ended.stderr


@pytest.mark.long
def test_what_a_library_prints_stands_beside_the_summary_not_in_it(build):
    library = f"library={build('libprints.so', '-DPRINTS')}"
    words = [sys.executable, "-m", "hil_bench", "run", "--hub", "0", "--duration", "0.01", "--json"]
    ended = subprocess.run(
        [*words, "--controller", "library", library], capture_output=True, text=True, check=False
    )
    assert json.loads(ended.stdout)["ended_by"] is None
    assert "one line\n" in ended.stderr


@pytest.mark.long
@pytest.mark.parametrize("is_asked", [False, True])
def test_a_run_whose_library_never_comes_back_ends_with_a_line(build, tmp_path, is_asked):
    """By its patience of 1 s, or soon after Ctrl-C; files, another controller, no leftovers."""
    (tmp_path / "bench.toml").write_text(
        f'[controllers.a]\nkind = "library"\nlibrary = "{build("libhangs.so", "-DHANGS")}"\n'
        f"patience_s = {1000 if is_asked else 1}\n"
        '[controllers.b]\nkind = "program"\n'
        'command = ["sh", "-c", "echo $$ > pid; exec sleep 99"]\n'
    )
    words = [sys.executable, "-m", "hil_bench", "run", "bench.toml", "--hub", "0", "--json"]
    folder = tmp_path / "temporary"
    folder.mkdir()
    run = subprocess.Popen(
        [*words, "--duration", "9", "--record", "r.csv"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(folder), "XDG_RUNTIME_DIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    while run.stderr.readline() != "hangs\n":
        pass
    if is_asked:
        run.send_signal(signal.SIGINT)
    said = run.communicate()[1].splitlines()
    assert run.returncode == ExitCode.BUS
    late = LATE.format("0.050") if not is_asked else "at 0.050 s the controller did not come back: "
    assert said[-1].startswith(f"hil-bench: error: controller a: {late}")
    rows = (tmp_path / "r.csv").read_text().splitlines()
    assert float(rows[-1].split(",")[0]) == pytest.approx(0.049)
    assert list(folder.iterdir()) == []
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ('"a"', '"a" is not a table; write it as {'),
        ("{ a = [1] }", "a: an array is no setting; write it as {"),
        ('{ "a=b" = 1 }', "'a=b': cannot be passed to a library"),
    ],
)
def test_settings_that_cannot_be_passed_are_refused(tmp_path, settings, words):
    text = f'[controllers.a]\nkind = "library"\nlibrary = "a.so"\nsettings = {settings}\n'
    (tmp_path / "bench.toml").write_text(text)
    with pytest.raises(ConfigError) as error:
        load_config(tmp_path / "bench.toml")
    assert words in str(error.value)


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The position controller of examples/firmware as a library."""
    folder = tmp_path_factory.mktemp("example")
    path = folder / "libposition_control.so"
    words = ["make", "--silent", "-C", ROOT / "examples/firmware", f"HIL={INCLUDE}"]
    python = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{python}{os.pathsep}{os.environ['PATH']}"}
    subprocess.run([*words, f"BUILD={folder}", path], check=True, env=environment)
    return path


def drive(example, **settings):
    table = {"kind": "library", "library": str(example), "settings": settings}
    bench = VirtualBench(load_config(tables={"controllers": {"c": table}}))
    with bench:
        bench.run(1.5)
        return bench.signals["axis1.position"].copy(), [tuple(each) for each in bench.frames]


def test_the_example_moves_the_cylinder_the_same_way_twice(example):
    position, frames = drive(example, targets_mm="30", dwell_ms=100)
    assert position.max() == pytest.approx(0.03, abs=5e-4)
    # SETTLED of position_control.c is 0.1 mm, which it has held for 100 ms before it ended.
    assert (abs(position - 0.03) < 1e-4).sum() >= 100
    again, same = drive(example, targets_mm="30", dwell_ms=100)
    assert (again == position).all()
    assert same == frames


def test_a_setting_that_it_does_not_know_is_refused(example):
    with pytest.raises(ControllerError, match="target=3: is no setting of it; targets_mm, "):
        drive(example, target=3)
