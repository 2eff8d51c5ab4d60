"""`hil-bench run` whose helper processes are killed: the loop goes on, and they come back."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import can
import pytest
from support.patience import GUARD

pytestmark = [
    pytest.mark.long,  # real processes, which start twice
    pytest.mark.skipif(sys.platform != "linux", reason="finds the helpers in /proc"),
]

KILLED = "its process was killed (SIGKILL, by somebody or for want of memory)"
READ_PRESSURE = bytes.fromhex("0001 0000 0006 02 04 0000 0002")
READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")


class Run:
    """A run in a process of its own."""

    def __init__(self, *words):
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-m", "hil_bench", "run", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.introduction = ""
        while "encoder_406" not in self.introduction:
            self.introduction += self._process.stdout.readline()

    def kill_helper(self):
        """Kill its helper, which is the only child beside multiprocessing's own."""
        (child,) = [child for child in self._children() if "spawn_main" in command_of(child)]
        os.kill(child, signal.SIGKILL)

    def hear(self):
        """Return the next line on standard error."""
        return self._process.stderr.readline().rstrip("\n")

    def stop(self):
        self._process.send_signal(signal.SIGTERM)
        out, err = self._process.communicate()
        return self._process.returncode, out, err

    def _children(self):
        task = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        return list(map(int, task.read_text(encoding="ascii").split()))


def command_of(pid):
    return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")


@pytest.fixture
def start():
    runs = []

    def start_one(*words):
        runs.append(Run(*words))
        return runs[-1]

    yield start_one
    for run in runs:
        if run._process.poll() is None:
            run._process.kill()
        run._process.communicate()


def pressure_registers(port):
    with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
        connection.sendall(READ_PRESSURE)
        return connection.recv(100)


def test_a_modbus_server_comes_back_at_its_port(start, make_file):
    config = make_file("bench.toml", "[modbus]\nport = 0\n")
    run = start(str(config), "-i", "virtual", "-c", "killed_modbus")
    port = int(re.search(r"modbus TCP 127\.0\.0\.1:(\d+)", run.introduction)[1])
    before = pressure_registers(port)
    assert before[7] == 0x04  # function 4, and no exception
    run.kill_helper()
    assert run.hear().startswith(f"hil-bench: Modbus server: {KILLED}; ")
    assert run.hear() == f"hil-bench: Modbus server: runs again (TCP 127.0.0.1:{port})"
    assert pressure_registers(port) == before  # at rest nothing changes
    code, out, err = run.stop()
    assert (code, err) == (130, "")
    assert "helper    Modbus server ended once, last: was killed" in out


def test_a_hub_comes_back_and_the_bench_answers_on_it(start):
    run = start("--hub", "0")
    port = int(re.search(r"port=(\d+)", run.introduction)[1])
    run.kill_helper()
    assert run.hear().startswith(f"hil-bench: hub 127.0.0.1:{port}: {KILLED}; ")
    assert run.hear() == f"hil-bench: hub 127.0.0.1:{port}: runs again"
    with can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=port) as bus:
        request = can.Message(arbitration_id=0x601, data=READ_DEVICE_TYPE, is_extended_id=False)
        bus.send(request)
        answer = bus.recv(GUARD)
    assert answer.arbitration_id == 0x581
    assert bytes(answer.data[:4]) == bytes.fromhex("43001000")  # an upload of 0x1000.00
    code, out, err = run.stop()
    assert (code, err) == (130, "")
    assert "1 times the interface went down" in out


def test_a_run_ends_with_its_recording_where_that_is_wanted(start, tmp_path):
    path = tmp_path / "run.csv"
    words = ["-i", "virtual", "-c", "killed_recorder", "--record", str(path), "--end-on-loss"]
    run = start(*words)
    run.kill_helper()
    assert f"{path}: recording ended at " in run.hear()
    assert run._process.wait(GUARD) == 5
