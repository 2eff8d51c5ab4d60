"""The example program: what it does to the bench, and its exit codes."""

import contextlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

from hil_drivers import Network, ProportionalValve, ValveState

PROGRAM = Path(__file__).parents[2] / "examples" / "position_control.py"


@pytest.fixture
def start(hub_port):
    """Starts the program on the bench behind the hub."""

    @contextlib.contextmanager
    def start_it(*arguments):
        command = [sys.executable, PROGRAM, "-i", "socketcand", "-c", "can0"]
        command += ["--bus-kwargs", "host=127.0.0.1", f"port={hub_port}", *arguments]
        with subprocess.Popen(  # noqa: S603 - our own program
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            yield process

    return start_it


def run(*arguments):
    return subprocess.run(  # noqa: S603 - our own program
        [sys.executable, PROGRAM, *arguments], capture_output=True, text=True, check=False
    )


@pytest.mark.long
def test_it_moves_the_cylinder_and_sums_up(start):
    with start("--duration", "1.5", "--period-ms", "5", "--waypoints-mm", "20", "0") as process:
        lines, errors = process.communicate()
    assert (process.returncode, errors) == (0, "")
    assert len(lines.splitlines()) == 3  # at 0 s and at 1 s, and the summary
    assert "tracking error RMS" in lines


@pytest.mark.long
@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_the_valve_disabled(start, hub_port, signal_number):
    with start("--duration", "30", "--period-ms", "5") as process:
        assert "set-point" in process.stdout.readline()
        process.send_signal(signal_number)
        lines, errors = process.communicate()
    assert (process.returncode, errors) == (130, "")
    assert "tracking error RMS" in lines
    with can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=hub_port) as bus:
        valve = ProportionalValve(Network(bus, clock=time.monotonic), 1)
        assert valve.read_state() is ValveState.DISABLED


@pytest.mark.long
def test_a_device_that_is_not_there_is_a_failure(start):
    with start("--position-node", "99") as process:
        _, errors = process.communicate()
    assert process.returncode == 1
    assert errors == (
        "position_control: error: node 99: no answer within 2 s; "
        "check node-ID, power, wiring and bit rate\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "cannot open the bus"),
        (("-i", "virtual", "-c", "x", "--valve-node", "300"), "node-ID 300"),
        (("-i", "virtual", "-c", "x", "--valve-eds", "missing.eds"), "missing.eds"),
        (("-i", "virtual", "-c", "x", "--period-ms", "-1"), "a positive number is right"),
        (("-i", "virtual", "-c", "x", "--node", "1"), "heartbeat under node-ID 1"),
    ],
)
def test_a_users_mistake_is_one_line_and_2(arguments, message, monkeypatch):
    monkeypatch.delenv("CAN_INTERFACE", raising=False)
    ended = run(*arguments)
    assert ended.returncode == 2
    assert message in ended.stderr.splitlines()[-1]
    assert "Traceback" not in ended.stderr


def test_a_bus_that_cannot_be_opened_is_3():
    ended = run("-i", "socketcan", "-c", "can-that-is-not")
    assert ended.returncode == 3
    assert ended.stderr.startswith("position_control: error: cannot open the bus: ")
    assert ended.stderr.count("\n") == 1
