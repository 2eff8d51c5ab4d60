"""The plugin in a pytest of its own, and the bench that its fixtures give.

That pytest runs in this process, unless it starts workers. What it imports for the first time is
dropped at its end, so what takes long to import is imported here.
"""

import multiprocessing.heap  # noqa: F401 - a run in this process would drop it again, and keep who uses it
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib.figure
import numpy as np
import pytest

from device_profiles import IMITATIONS
from hil_bench.abilities.bench_fixtures import failure_report
from hil_bench.abilities.common.pytest_options import is_on
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import WaitTimeoutError

pytest_plugins = ["pytester"]
__all__ = ["failure_report", "matplotlib"]

EXAMPLES = Path(__file__).parents[3] / "examples"
KINDS = {"trace": ".log", "signals": ".csv", "plot": ".png"}


@pytest.fixture(autouse=True)
def pictures(request, monkeypatch):
    """The pictures of failed tests: path and faults. Each takes half a second; long tests draw."""
    drawn = []
    if request.node.get_closest_marker("long") is None:
        monkeypatch.setattr(
            "hil_bench.abilities.recording.plot.plot_result",
            lambda _recording, path, *, title, spans: drawn.append((path.name, title, *spans)),
        )
    return drawn


def test_a_driver_is_set_up_without_a_lost_request(bench, valve):  # noqa: ARG001 - that it is there
    """A lost request costs a time-out of 100 ms; without one all of it takes 25 ms."""
    assert bench.now() < 0.1


def test_a_test_moves_the_cylinder(bench, valve, position, pressure):
    valve.enable()
    valve.spool_setpoint = 0.5
    taken = bench.run_until(lambda: position.position > 0.05, timeout=2.0)
    # 50 % is nu = 0.65e-3 m, z = 0.35e-3 m: v = z K sqrt(P_S / 2) / mean area = 0.102 m/s without
    # friction (eqs. (14), (16), Table I), so 50 mm take half a second.
    assert taken == pytest.approx(0.49, rel=0.1)
    assert pressure.pressure == pytest.approx(bench.signals["axis1.P_A"][-1], rel=0.02)


@pytest.mark.parametrize(
    ("words", "ini", "is_realtime"),
    [
        ((), "", False),
        (("--hil-realtime",), "", True),
        ((), "hil_realtime = true", True),
        ((), "hil_realtime = false", False),
        (("--hil-realtime",), "hil_realtime = false", True),
    ],
)
def test_a_switch_is_on_by_its_option_or_by_its_ini_key(pytester, words, ini, is_realtime):
    pytester.makeini(f"[pytest]\n{ini}\n")
    assert is_on(pytester.parseconfig(*words), "realtime") == is_realtime


def test_drivers_are_on_the_bus_of_their_node(pytester):
    pytester.makepyfile(
        "def test_moves(bench, valve, pressure, position):\n"
        "    valve.enable()\n"
        "    valve.spool_setpoint = 0.5\n"
        "    bench.run_until(lambda: position.position > 0.05, timeout=2.0)\n"
        "    bench.run(0.2)\n"
        "    seen, plant = position.position, bench.values['axis1.position']\n"
        "    assert abs(seen - plant) < 0.001\n"  # 0.1 m/s, an event timer of 5 ms
        "    assert abs(pressure.pressure / bench.values['axis1.P_A'] - 1) < 0.02\n"
    )
    result = pytester.runpytest(f"--hil-config={EXAMPLES / 'two_buses.toml'}")
    result.assert_outcomes(passed=1)


@pytest.mark.long
def test_a_bench_of_nodes_alone_is_scripted_and_drivers_of_an_axis_are_skipped(pytester):
    eds = IMITATIONS / "analogue_io_401.eds"
    pytester.makefile(".toml", io=f'[nodes.io]\nnode_id = 10\neds = "{eds}"\n')
    pytester.makepyfile(
        "def test_an_input_reaches_the_controller(bench, network):\n"
        "    bench.run(0.002)\n"
        "    network.start_node(10)\n"
        "    heard = []\n"
        "    network.subscribe(0x28A, lambda data, now: heard.append(data) or True)\n"
        "    bench.run(0.01)\n"
        "    bench.nodes['io']['0x6401.01'] = 1234\n"
        "    bench.run(0.001)\n"
        "    assert heard[-1] == bytes.fromhex('d204000000000000')\n"
        "def test_drives(valve):\n"
        "    pass\n"
    )
    result = pytester.runpytest_subprocess("--hil-config=io.toml", "-rs")
    result.assert_outcomes(passed=1, skipped=1)
    result.stdout.fnmatch_lines(["*the first axis of the bench has no valve_408*"])


def test_each_test_gets_a_fresh_bench(bench):
    assert bench.now() == 0.0
    bench.run(0.25)
    assert bench.now() == pytest.approx(0.25)
    signals = bench.signals
    assert signals["time"] == pytest.approx(np.arange(1, 251) * 1e-3)
    # Nobody enabled the valve: the piston stays where P_A A_A = P_B A_B holds it, to rounding.
    assert np.all(np.abs(signals["axis1.position"]) < 1e-15)


def test_a_condition_that_does_not_come_is_an_error(bench):
    with pytest.raises(WaitTimeoutError, match=r"^condition not met within 0\.1 s of bench time$"):
        bench.run_until(lambda: False, timeout=0.1)
    assert bench.now() == pytest.approx(0.1)


def test_it_is_met_in_the_tick_it_comes_true(bench):
    assert bench.run_until(lambda: bench.now() > 0.0215, timeout=1.0) == pytest.approx(0.022)


def test_the_bus_is_python_cans(can_bus):
    assert can_bus.recv(1.0).arbitration_id == 0x701  # the valve's boot-up message


@pytest.mark.long
def test_a_failed_test_shows_the_last_frames_and_leaves_its_files(pytester):
    pytester.makepyfile("def test_fails(bench):\n    bench.run(0.01)\n    assert False")
    result = pytester.runpytest("--hil-artifacts=left", "--junitxml=junit.xml")
    result.assert_outcomes(failed=1)
    name = "test_a_failed_test_shows_the_last_frames_and_leaves_its_files.py-test_fails"
    files = {what: f"left/{name}{suffix}" for what, suffix in KINDS.items()}
    result.stdout.fnmatch_lines(
        [
            "*last 20 frames that are not cyclic*",
            "(0.001000) 701#00 * from the bench  valve heartbeat: boot-up",
            "*last values*",
            "axis1.P_A * Pa",
        ]
    )
    result.stdout.fnmatch_lines([f"{what:9} {path}" for what, path in files.items()])
    trace = (pytester.path / files["trace"]).read_text()
    assert trace.startswith("(0.001000) can0 701#00\n")
    assert len(read_recording(pytester.path / files["signals"])) == 10
    assert (pytester.path / files["plot"]).read_bytes().startswith(b"\x89PNG")
    junit = (pytester.path / "junit.xml").read_text()
    assert f'<property name="hil_trace" value="{files["trace"]}" />' in junit


@pytest.mark.parametrize(
    ("options", "config", "seed", "interface"),
    [
        ([], "built-in bench", "1", "virtual bench"),
        (
            ["--hil-config=bench.toml", "--hil-interface=virtual", "--hil-channel=x"],
            *("bench.toml", "3", "virtual x"),
        ),
    ],
)
def test_the_junit_file_tells_what_a_test_ran_on(pytester, options, config, seed, interface):
    pytester.makefile(".toml", bench="[bench]\nseed = 3\n")
    pytester.makepyfile("def test_it(bench):\n    pass\ndef test_else():\n    pass")
    pytester.runpytest("--junitxml=junit.xml", *options)
    cases = ET.parse(pytester.path / "junit.xml").iter("testcase")  # noqa: S314 - our own
    on_it, on_nothing = [
        {entry.get("name"): entry.get("value") for entry in case.iter("property")} for case in cases
    ]
    assert re.fullmatch(r"hil-bench \d\S+, python-can \d\S+", on_it.pop("hil_versions"))
    assert on_it == {"hil_config": config, "hil_seed": seed, "hil_interface": interface}
    assert on_nothing == {}


def test_an_error_of_the_controller_shows_the_line_of_the_test(pytester):
    pytester.makepyfile(
        "def test_late(bench):\n    bench.run_until(lambda: False, timeout=0)\n"
        "def test_bug(bench):\n    bench.run(None)\n"
    )
    result = pytester.runpytest("--tb=short")
    result.assert_outcomes(failed=2)
    late, bug = re.split(r"_{5,} test_\w+ _{5,}", result.stdout.str())[1:]
    assert re.findall(r"^\S+\.py:\d+: in (\w+)$", late, re.MULTILINE) == ["test_late"]
    assert "virtual_bench.py" in bug  # what is not ours to explain is shown whole
    assert " last " not in late  # its bench has not run: there are no frames and no values


def test_a_report_reads_pdos_and_leaves_out_what_is_cyclic(pytester):
    pytester.makepyfile(
        "def test_fails(bench, valve, position):\n"
        "    valve.enable()\n    valve.spool_setpoint = 0.5\n    bench.run(0.5)\n"
        "    valve.node.read(0x6040, 9)\n"
    )
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    news, rest = result.stdout.str().split("- last cyclic frames -")
    news = news.split("frames that are not cyclic -")[1]
    # 50 % is 0x2000 of 0x4000; 0x0007 enables, 0x000F is ACTIVE (CiA 408).
    assert re.search(r"201#07000020 .* to the bench  valve RPDO1: .* 0x0007 DHM, .* 50 %\n", news)
    assert re.search(r"181#0F000000 .* valve TPDO1: .* 0x000F ACTIVE, .* 0 %\n", news)
    assert news.count("valve TPDO1") < 5
    assert "position TPDO1" not in news
    assert re.search(r"184#\w+ .* position TPDO1: Position value [\d.]+ mm, Speed value", rest)


def test_an_error_of_a_driver_shows_the_line_of_the_test_alone(pytester):
    pytester.makepyfile(
        "def test_silent(bench, valve, faults):\n"
        "    faults.silence('valve')\n    valve.node.read(0x6041)\n"
    )
    result = pytester.runpytest("--tb=short")
    result.assert_outcomes(failed=1)
    text = result.stdout.str().split("- last 20 frames")[0]
    assert re.findall(r"^\S+\.py:\d+: in (\w+)$", text, re.MULTILINE) == ["test_silent"]
    assert "During handling" not in text
    assert "direct cause" not in text


def test_a_marker_names_what_the_bench_must_have(pytester):
    pytester.makepyfile(
        "import pytest\n"
        "@pytest.mark.hil_requires('valve_408', 'encoder_406')\ndef test_runs():\n    pass\n"
        "@pytest.mark.hil_requires('io_401')\ndef test_io():\n    assert False\n"
        "@pytest.mark.hil_requires(axes=2)\ndef test_two():\n    assert False\n"
    )
    result = pytester.runpytest("-rs", "--strict-markers", "--hil-realtime")
    result.assert_outcomes(passed=1, skipped=2)
    result.stdout.fnmatch_lines(["hil-bench: realtime; hil-bench [0-9]*, python-can [0-9]*"])
    result.stdout.fnmatch_lines_random(
        ["*the first axis of the bench has no io_401*", "*needs a bench of 2 axes; this one has 1*"]
    )


@pytest.mark.long
def test_each_worker_has_a_bus_of_its_own(pytester, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # two ticks are not worth compiling the plant
    pytester.makepyfile(
        "import pathlib, sys\n"
        "SCRIPT = ('import os, time; print(os.environ[\"HIL_BENCH_BUS\"], flush=True); '\n"
        "          'time.sleep(99)')\n"
        "def run(firmware, name):\n"
        "    program = firmware(sys.executable, '-c', SCRIPT)\n"
        "    while not program.stdout:\n        program.link.step()\n"
        "    pathlib.Path(name).write_text(program.stdout)\n"
        "def test_one(firmware):\n    run(firmware, 'one')\n"
        "def test_two(firmware):\n    run(firmware, 'two')\n"
    )
    result = pytester.runpytest_subprocess("-n2", "-p", "xdist")
    result.assert_outcomes(passed=2)
    buses = {(pytester.path / name).read_text() for name in ("one", "two")}
    assert len(buses) == 2


def test_workers_are_not_to_share_an_interface(pytester):
    pytester.makepyfile("def test_it(firmware):\n    pass")
    result = pytester.runpytest("-n2", "--hil-firmware-bus=vcan0")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(
        ["ERROR: --hil-firmware-bus vcan0: workers would share it; give vcan{worker}, one each"]
    )


def test_a_bus_that_broke_is_told_once(pytester):
    pytester.makepyfile("def test_a(can_bus):\n    pass\ndef test_b(can_bus):\n    pass")
    result = pytester.runpytest("-rs", "--hil-interface=none_such")
    result.assert_outcomes(errors=1, skipped=1)
    why = "unknown CAN interface 'none_such'; python-can has"
    result.stdout.fnmatch_lines([f"E * hil_bench.errors.BusError: {why} *"])
    result.stdout.fnmatch_lines([f"*the bench's bus broke before: {why} *"])


def test_a_failed_test_that_asks_for_a_driver_alone_shows_its_frames(pytester):
    pytester.makepyfile("def test_fails(valve):\n    assert False")
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*last 20 frames that are not cyclic*"])


def test_a_failed_test_shows_its_faults(pytester, pictures):
    pytester.makepyfile(
        "def test_fails(bench, faults):\n"
        "    with faults.freeze('pressure_a', duration=0.01):\n"
        "        bench.run(0.02)\n"
        "        assert False\n"
    )
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "*- faults -*",
            "(0.001000) freeze pressure_a begins",
            "(0.011000) freeze pressure_a ends, and has changed nothing",
        ]
    )
    name = "test_a_failed_test_shows_its_faults.py-test_fails"
    span = (0.001, pytest.approx(0.011), "freeze pressure_a, and has changed nothing")
    assert pictures == [(f"{name}.png", name, span)]


@pytest.mark.parametrize(
    "how",
    [
        "def test_in_vain(bench, faults):",
        "def test_in_vain(bench):\n    faults = bench.faults",
        "def test_in_vain(rig):\n    bench, faults = rig, rig.faults",
        (
            "def test_in_vain(valve, request):\n"
            "    bench = request.getfixturevalue('bench')\n"
            "    faults = bench.faults"
        ),
    ],
)
def test_a_test_that_passes_beside_a_fault_that_changes_nothing_is_an_error(pytester, how):
    assert {"lose", "silence", "offset"} <= {*FAULT_KINDS.names()}
    pytester.makepyfile(
        "import pytest\n"
        "@pytest.fixture\n"
        "def rig(bench):\n"
        "    return bench\n"
        f"{how}\n"
        "    faults.lose('valve', can_id=0x7ff)\n"
        "    faults.silence('valve', at=9.0)\n"
        "    bench.run(0.02)\n"
        "def test_in_earnest(bench, faults):\n"
        "    faults.offset('position', 1e-3)\n"
        "    faults.silence('valve', at=9.0).clear()\n"
        "    bench.run(0.02)\n"
    )
    result = pytester.runpytest()
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines(
        ["*not exercised: nothing was changed by lose valve, silence valve"]
    )


def test_hardware_tests_are_skipped_with_the_option_that_runs_them(pytester):
    pytester.makepyfile(
        "import pytest\n@pytest.mark.hil_hardware\ndef test_it():\n    assert False"
    )
    result = pytester.runpytest("-rs", "--strict-markers")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*needs the physical bench: --hil-interface names its bus*"])


def test_on_a_physical_bus_time_passes_and_who_looks_into_the_bench_is_skipped(pytester):
    pytester.makepyfile(
        "import pytest\n"
        "def test_time(bench, can_bus):\n"
        "    assert bench.run_until(lambda: bench.now() > 0.02, timeout=30) >= 0.0\n"
        "    with pytest.raises(TimeoutError):\n"
        "        bench.run_until(lambda: False, timeout=0.01)\n"
        "    bench.run(0.001)\n"
        "def test_signals(bench):\n    assert bench.signals is None\n"
        "def test_faults(faults):\n    assert False\n"
        "def test_firmware(firmware):\n    assert False\n"
    )
    result = pytester.runpytest("-rs", "--hil-interface", "virtual")
    result.assert_outcomes(passed=1, skipped=3)
    why = "needs the virtual bench, which --hil-interface turns off"
    result.stdout.fnmatch_lines_random(
        ["hil-bench: interface virtual; *", f"*bench.signals {why}", f"*bench.faults {why}"]
    )
    result.stdout.fnmatch_lines([f"*firmware {why}"])


def test_a_physical_bus_is_opened_as_named(pytester):
    pytester.makepyfile(
        "def test_it(can_bus):\n    assert can_bus.channel_info.endswith('plugin_test')"
    )
    result = pytester.runpytest("--hil-interface=virtual", "--hil-channel=plugin_test")
    result.assert_outcomes(passed=1)


def test_options_may_stand_in_the_ini_file(pytester):
    pytester.makefile(".toml", bench="[nodes.valve]\nprofile = 'valve_408'\nnode_id = 9\n")
    pytester.makeini("[pytest]\nhil_config = bench.toml\nhil_seed = 5")
    pytester.makepyfile(
        "def test_it(valve, hil_config):\n"
        "    assert (valve.node.id, hil_config.seed) == (9, 5)\n"
        "def test_sensor(position):\n    pass"
    )
    result = pytester.runpytest("-rs")
    result.assert_outcomes(passed=1, skipped=1)
    result.stdout.fnmatch_lines(["*the first axis of the bench has no encoder_406*"])


def test_a_config_that_is_not_there_is_one_usage_error(pytester):
    pytester.makepyfile("def test_it(bench):\n    pass")
    result = pytester.runpytest("--hil-config=none.toml")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    wrong = "--hil-config: none.toml: cannot be read: No such file or directory; give a TOML file"
    assert result.stderr.str().split() == f"ERROR: {wrong}".split()
    assert "Traceback" not in result.stdout.str()


@pytest.mark.parametrize("seed", ["abc", "-1", "1.5"])
def test_a_seed_that_is_none_is_one_usage_error(pytester, seed):
    pytester.makepyfile("def test_it():\n    pass")
    result = pytester.runpytest(f"--hil-seed={seed}")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert result.stderr.str().strip() == f"ERROR: --hil-seed {seed}: give an integer, 0 or more"


def test_paths_of_the_ini_file_count_from_its_folder(pytester):
    pytester.makefile(".toml", bench="[bench]\nseed = 3\n")
    pytester.makeini("[pytest]\nhil_config = bench.toml\nhil_artifacts = left\n")
    below = pytester.mkdir("below")
    (below / "test_it.py").write_text(
        "def test_it(bench, hil_config):\n    assert hil_config.seed == 3\n    assert False\n"
    )
    monkeypatch = pytester._monkeypatch
    monkeypatch.chdir(below)
    pytester.runpytest().assert_outcomes(failed=1)
    assert (pytester.path / "left").is_dir()


def test_a_rootdir_that_the_config_has_moved_is_named(pytester, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text("[bench]\nseed = 3\n")
    pytester.makepyfile("def test_it(bench):\n    pass")
    result = pytester.runpytest("--hil-config", path, pytester.path)
    result.stdout.fnmatch_lines([f"*write --hil-config={path}"])


def test_a_test_may_have_tables_and_devices_of_its_own(pytester):
    pytester.makepyfile(
        "import pytest\n"
        "@pytest.mark.hil(plant={'axis1': {'moving_mass_kg': 50}})\n"
        "class TestHeavy:\n"
        "    def test_mass(self, bench):\n"
        "        assert bench.config.axes[0].parameters.m == 50\n"
        "    @pytest.mark.hil(plant={'axis1': {'supply_pressure_bar': 80}})\n"
        "    def test_both(self, bench, device):\n"
        "        parameters = bench.config.axes[0].parameters\n"
        "        assert (parameters.m, parameters.P_S) == (50, 80e5)\n"
        "        bench.run(0.02)\n"
        "        seen, plant = device('pressure_b').pressure, bench.values['axis1.P_B']\n"
        "        assert abs(seen / plant - 1) < 0.02\n"
        "        assert device('pressure_b') is device('pressure_b')\n"
        "def test_plain(bench):\n    assert bench.config.axes[0].parameters.m == 20\n"
        "@pytest.mark.hil(plant={'axis1': {'mass': 50}})\ndef test_wrong(bench):\n    pass\n"
        "def test_no_such(device):\n    device('pressure_c')\n"
    )
    result = pytester.runpytest("--strict-markers")
    result.assert_outcomes(passed=3, failed=1, errors=1)
    result.stdout.fnmatch_lines_random(
        [
            "*@pytest.mark.hil: built-in bench:plant.axis1.mass: unknown key;*",
            "*device('pressure_c'): the bench has valve, pressure_a, pressure_b, position",
        ]
    )


def test_it_can_be_left_out(pytester):
    pytester.makepyfile("def test_it(bench):\n    pass")
    result = pytester.runpytest("-p", "no:hil_bench")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*fixture 'bench' not found*"])


def test_loading_it_imports_nothing_of_weight():
    script = (
        "import sys, pytest\nbefore = set(sys.modules)\nimport hil_bench.pytest_plugin\n"
        "import hil_bench.abilities.bench_fixtures.fixtures\n"
        "print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(  # noqa: S603 - a script of our own
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    inner = "abilities abilities.bench_fixtures abilities.bench_fixtures.fixtures abilities.common"
    inner += " abilities.common.pytest_options ability canopen_device canopen_device.errors errors"
    names = [f"hil_bench.{name}" for name in f"{inner} pytest_plugin registry".split()]
    assert done.stdout == f"{['hil_bench', *names]}\n"


@pytest.mark.long
def test_each_test_is_recorded_and_a_failed_one_names_the_file(pytester):
    pytester.makepyfile(
        "def test_moves(bench, valve):\n    valve.enable()\n    bench.run(0.5)\n    assert False\n"
        "def test_rests(bench):\n    bench.run(0.01)\n"
    )
    result = pytester.runpytest("--hil-record=results")
    result.assert_outcomes(failed=1, passed=1)
    result.stdout.fnmatch_lines(["*hil-bench files*", "recording results/*test_moves.mf4"])
    name = f"{test_each_test_is_recorded_and_a_failed_one_names_the_file.__name__}.py_test_"
    moves, rests = (
        pytester.path / "results" / f"{name}{which}.mf4" for which in ("moves", "rests")
    )
    assert len(read_recording(rests)) == 10
    assert read_recording(moves)["time"][-1] > 0.5
    assert 0x201 in {logged.frame.can_id for logged in read_frames(moves)}


def test_frames_of_a_physical_bus_are_recorded_by_another_process(pytester):
    pytester.makepyfile("def test_talks(network):\n    network.send(0x123, b'abc')\n")
    bus = ("--hil-interface=virtual", "--hil-channel=test_record")
    pytester.runpytest(*bus, "--hil-record=results").assert_outcomes(passed=1)
    (path,) = (pytester.path / "results").iterdir()
    sent = [logged.frame for logged in read_frames(path) if not logged.is_received]
    # The controller's boot-up message, then the test's own frame.
    assert sent == [Frame(0x77F, b"\x00"), Frame(0x123, b"abc")]


def test_firmware_that_is_not_there_is_the_first_that_is_said(pytester):
    pytester.makepyfile("def test_it(firmware):\n    firmware('build/none', '{bus}')\n")
    result = pytester.runpytest_inprocess()
    result.assert_outcomes(failed=1)
    shown = result.outlines[result.outlines.index(f"{' test_it ':_^80}") :]
    place = next(n for n, line in enumerate(shown) if line.startswith(">"))
    assert shown[place].strip() == ">       firmware('build/none', '{bus}')"
    assert shown[place + 1].startswith(
        "E       hil_bench.errors.ControllerFileError: build/none: cannot be started: No such file"
    )
    assert place < 6


def test_firmware_without_sync_fails_its_test_as_early_as_is_wished(pytester):
    pytester.makepyfile(
        "import sys\n"
        "def test_it(firmware, bench):\n"
        "    firmware(sys.executable, '-c', 'input()')\n"
        "    firmware(sys.executable, '-c', 'import time; time.sleep(60)')\n"
        "    bench.run(1.0)\n"
    )
    result = pytester.runpytest_inprocess("--hil-firmware-patience=0.2")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["E * nobody has sent a frame for 0.2 s, *--hil-firmware-patience*--hil-realtime"]
    )


@pytest.mark.parametrize("text", ["0", "-1", "inf", "soon"])
def test_a_patience_that_is_none_is_refused(pytester, text):
    result = pytester.runpytest_inprocess(f"--hil-firmware-patience={text}")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"*--hil-firmware-patience {text}: give a positive number*"])


def test_a_recording_that_is_lost_is_an_error_of_its_test(pytester, monkeypatch):
    """The test passes, and what was asked for is not there."""

    def write_rows(_file, _rows):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hil_bench.abilities.recording.mdf_writer.MdfFile.write_rows", write_rows)
    pytester.makepyfile("def test_it(bench):\n    bench.run(0.3)\n")
    result = pytester.runpytest_inprocess("--hil-record=out")
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*RecordingError: *test_it.mf4: *No space left on device*"])
