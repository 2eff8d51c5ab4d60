"""The controller against the bench: what a firmware team's CI runs.

pytest examples/firmware                                             in lock-step, any machine
pytest examples/firmware --hil-firmware-bus vcan0                    in lock-step on vcan
pytest examples/firmware --hil-firmware-bus vcan0 --hil-realtime     in real time on vcan
"""

import signal
import subprocess

import pytest

SETTLED = 100e-6  # [m], what the controller calls settled


def test_it_moves_to_its_targets_and_stays_there(bench, start):
    ended = start("--targets-mm", "40,-20").wait(timeout=10.0)
    assert ended == 0
    position = bench.signals["axis1.position"]
    assert position.max() == pytest.approx(0.040, abs=3e-3)  # a cycle of 10 ms overshoots by 1 mm
    assert position[-1] == pytest.approx(-0.020, abs=SETTLED)


def test_it_says_what_it_does(start):
    controller = start("--targets-mm", "10", "--dwell-ms", "100")
    assert controller.wait(timeout=10.0) == 0
    assert "mm at target 10.000 mm" in controller.stdout
    assert "largest error" in controller.stdout
    assert controller.stderr == ""


def test_the_pressures_stay_below_the_supply(bench, start):
    start("--targets-mm", "60", "--speed-mm-s", "250").wait(timeout=10.0)
    for chamber in ("axis1.P_A", "axis1.P_B"):
        assert bench.signals[chamber].max() < 110e5


def test_a_wish_to_stop_leaves_the_valve_centred_and_the_piston_at_rest(bench, start):
    controller = start("--targets-mm", "150")
    bench.run_until(lambda: bench.values["axis1.position"] > 0.02, timeout=5.0)
    assert controller.stop(signal.SIGTERM) == 130
    assert abs(bench.values["axis1.spool_position"]) < 0.01
    assert abs(bench.values["axis1.speed"]) < 2e-3


def test_a_target_beyond_the_stroke_ends_at_the_stop_with_an_error(bench, start):
    controller = start("--targets-mm", "250", "--speed-mm-s", "400", "--dwell-ms", "300")
    assert controller.wait(timeout=20.0) == 1
    assert "does not settle" in controller.stderr
    assert bench.values["axis1.position"] < 0.201


def test_a_dead_controller_leaves_the_valve_safe(bench, start, hil_realtime):
    if not hil_realtime:
        pytest.skip("in lock-step a dead controller stops time: --hil-realtime")
    controller = start("--targets-mm", "150")
    bench.run_until(lambda: bench.values["axis1.position"] > 0.02, timeout=10.0)
    controller.process.kill()
    bench.run_until(lambda: abs(bench.values["axis1.spool_position"]) < 0.01, timeout=4.0)


@pytest.mark.parametrize(
    ("arguments", "exit_code"),
    [
        (["--bus", "127.0.0.1:1", "--targets-mm", "10"], 3),
        (["--bus", "no_such_bus", "--targets-mm", "10"], 3),
        (["--targets-mm", "10"], 2),
        (["--bus", "vcan0", "--targets-mm", "ten"], 2),
        (["--bus", "vcan0", "--targets-mm", "10", "--period-us", "0"], 2),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(controller, arguments, exit_code):
    done = subprocess.run(
        [controller, *arguments], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == exit_code
    assert len(done.stderr.splitlines()) == 1


def interrupted_by(bench, controller, fault):
    """Let a fault happen in the middle of a move; return the exit code."""
    bench.run_until(lambda: bench.values["axis1.position"] > 0.02, timeout=10.0)
    fault()
    return controller.wait(timeout=10.0)


def test_a_broken_wire_ends_the_move_with_the_valve_safe(bench, faults, start):
    controller = start("--targets-mm", "150")
    assert interrupted_by(bench, controller, lambda: faults.break_wire("pressure_a")) == 1
    assert "pressure A (node 2): emergency 0x" in controller.stderr
    assert abs(bench.values["axis1.spool_position"]) < 0.01


def test_a_sensor_without_power_is_noticed(bench, faults, start):
    controller = start("--targets-mm", "150")
    assert interrupted_by(bench, controller, lambda: faults.reset("position")) == 1
    assert "position (node 4): " in controller.stderr
