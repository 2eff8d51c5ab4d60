"""The plugin in a pytest of its own, and the bench that its fixtures give."""

import subprocess
import sys

import numpy as np
import pytest

from hil_bench.errors import WaitTimeoutError
from hil_bench.recording.files import read_recording
from hil_bench.recording.frames import read_frames

pytest_plugins = ["pytester"]


def test_a_test_moves_the_cylinder(bench, valve, position, pressure):
    valve.enable()
    valve.spool_setpoint = 0.5
    taken = bench.run_until(lambda: position.position > 0.05, timeout=2.0)
    # 50 % is nu = 0.65e-3 m, z = 0.35e-3 m: v = z K sqrt(P_S / 2) / mean area = 0.102 m/s without
    # friction (eqs. (14), (16), Table I), so 50 mm take half a second.
    assert taken == pytest.approx(0.49, rel=0.1)
    assert pressure.pressure == pytest.approx(bench.signals["axis1.P_A"][-1], rel=0.02)


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


def test_a_failed_test_shows_the_last_frames(pytester):
    pytester.makepyfile("def test_fails(bench):\n    bench.run(0.01)\n    assert False")
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*last 20 frames on the bench's bus*", "(0.001000) 701#00 from the bench"]
    )


def test_hardware_tests_are_skipped_with_the_option_that_runs_them(pytester):
    pytester.makepyfile(
        "import pytest\n@pytest.mark.hil_hardware\ndef test_it():\n    assert False"
    )
    result = pytester.runpytest_subprocess("-rs", "--strict-markers")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*needs the physical bench: --hil-interface names its bus*"])


def test_the_virtual_bench_is_skipped_on_a_physical_bus(pytester):
    pytester.makepyfile("def test_it(bench):\n    assert False")
    result = pytester.runpytest_subprocess("-rs", "--hil-interface", "virtual")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(
        ["hil-bench: interface virtual", "*needs the virtual bench, which --hil-interface turns*"]
    )


def test_a_physical_bus_is_opened_as_named(pytester):
    pytester.makepyfile(
        "def test_it(can_bus):\n    assert can_bus.channel_info.endswith('plugin_test')"
    )
    result = pytester.runpytest_subprocess("--hil-interface=virtual", "--hil-channel=plugin_test")
    result.assert_outcomes(passed=1)


def test_options_may_stand_in_the_ini_file(pytester):
    pytester.makefile(".toml", bench="[nodes.valve]\nprofile = 'valve_408'\nnode_id = 9\n")
    pytester.makeini("[pytest]\nhil_config = bench.toml\nhil_seed = 5")
    pytester.makepyfile(
        "def test_it(valve, hil_config):\n"
        "    assert (valve.node.id, hil_config.seed) == (9, 5)\n"
        "def test_sensor(position):\n    pass"
    )
    result = pytester.runpytest_subprocess("-rs")
    result.assert_outcomes(passed=1, skipped=1)
    result.stdout.fnmatch_lines(["*the first axis of the bench has no encoder_406*"])


def test_it_can_be_left_out(pytester):
    pytester.makepyfile("def test_it(bench):\n    pass")
    result = pytester.runpytest_subprocess("-p", "no:hil_bench")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*fixture 'bench' not found*"])


def test_loading_it_imports_nothing_of_weight():
    script = (
        "import sys, pytest\nbefore = set(sys.modules)\nimport hil_bench.pytest_plugin\n"
        "print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(  # noqa: S603 - a script of our own
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "['hil_bench', 'hil_bench.pytest_plugin']\n"


def test_each_test_is_recorded_and_a_failed_one_names_the_file(pytester):
    pytester.makepyfile(
        "def test_moves(bench, valve):\n    valve.enable()\n    bench.run(0.5)\n    assert False\n"
        "def test_rests(bench):\n    bench.run(0.01)\n"
    )
    result = pytester.runpytest_subprocess("--hil-record=results")
    result.assert_outcomes(failed=1, passed=1)
    result.stdout.fnmatch_lines(["*recording of this test*", "results/*test_moves.mf4"])
    name = f"{test_each_test_is_recorded_and_a_failed_one_names_the_file.__name__}.py_test_"
    moves, rests = (
        pytester.path / "results" / f"{name}{which}.mf4" for which in ("moves", "rests")
    )
    assert len(read_recording(rests)) == 10
    assert read_recording(moves)["time"][-1] > 0.5
    assert 0x201 in {logged.frame.can_id for logged in read_frames(moves)}
