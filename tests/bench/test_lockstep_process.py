"""`hil-bench run --lockstep --hub` as a process: suspended, ended, left by its controller.

The controller is this test, a bare socket that waits for the answer to an SDO request behind each
SYNC, which comes last.
"""

import re
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.patience import GUARD


class Controller:
    """One program on the hub."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=GUARD)
        self._rest = b""
        for command, answer in ((b"", b"< hi >"), (b"< open can0 >", b"< ok >")):
            self._socket.sendall(command)
            assert self.hear() == answer
        self._socket.sendall(b"< rawmode >")
        assert self.hear() == b"< ok >"

    def hear(self):
        """Return the next message, empty at the end of the connection."""
        while b">" not in self._rest:
            data = self._socket.recv(65_536)
            if not data:
                return b""
            self._rest += data
        message, _, self._rest = self._rest.partition(b">")
        return message + b">"

    def say(self, can_id, data=b""):
        text = b"< send %03X %d %b >" % (can_id, len(data), data.hex(" ").encode())
        self._socket.sendall(text)

    def ask(self):
        """Ask the position sensor for its device type, whose answer comes behind all else."""
        self.say(0x604, bytes.fromhex("4000100000000000"))

    def await_answer(self):
        """Return the frames up to the answer, without their times."""
        frames = []
        while not frames or frames[-1][0] != b"584":
            message = self.hear()
            assert message, "the bench has cut the connection"
            _, _, can_id, _, data, _ = message.split(b" ")
            frames.append((can_id, data))
        return frames

    def cycle(self, setpoint=8192):
        self.say(0x201, struct.pack("<Hh", 7, setpoint))
        self.say(0x080)
        self.ask()

    def close(self):
        self._socket.close()


class BenchProcess:
    """The bench."""

    def __init__(self, directory, *arguments):
        self.directory = directory
        command = [sys.executable, "-m", "hil_bench", "run", "--lockstep", "--hub", "0"]
        with (directory / "stderr").open("wb") as stderr:
            self.process = subprocess.Popen(  # noqa: S603 - our own program
                [*command, *arguments],
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                cwd=directory,
            )
        introduction = ""
        while "join " not in introduction:
            line = self.process.stdout.readline()
            assert line, (directory / "stderr").read_text()
            introduction += line
        self.port = int(re.search(r"port=(\d+)", introduction)[1])

    def await_state(self, letter):
        """Wait until the kernel says that the process is in a state."""
        stat = Path(f"/proc/{self.process.pid}/stat")
        while stat.read_text().rpartition(")")[2].split()[0] != letter:
            pass

    def end(self, number=signal.SIGTERM):
        """Return exit code and output after a signal."""
        self.process.send_signal(number)
        out = self.process.stdout.read()
        return self.process.wait(GUARD), out, (self.directory / "stderr").read_text()


@pytest.fixture
def start(tmp_path):
    processes = []

    def start_one(name, *arguments):
        directory = tmp_path / name
        directory.mkdir()
        processes.append(BenchProcess(directory, *arguments))
        return processes[-1]

    yield start_one
    for bench in processes:
        bench.process.kill()
        bench.process.wait()
        bench.process.stdout.close()


def drive(bench, *, is_suspended):
    """Let a controller drive for 40 cycles; suspend the bench in the middle of the 20th."""
    controller = Controller(bench.port)
    controller.say(0x000, b"\x01\x00")
    frames = []
    for number in range(40):
        if is_suspended and number == 20:
            bench.process.send_signal(signal.SIGSTOP)
            bench.await_state("T")
        controller.cycle(8192 if number < 20 else -8192)
        if is_suspended and number == 20:
            bench.process.send_signal(signal.SIGCONT)
        frames += controller.await_answer()
    controller.close()
    return frames


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux: /proc")
def test_a_suspended_bench_goes_on_where_it_was(start):
    traces, frames = [], []
    for name, is_suspended in (("suspended", True), ("undisturbed", False)):
        bench = start(name, "--record", "trace.log")
        frames.append(drive(bench, is_suspended=is_suspended))
        exit_code, out, err = bench.end()
        assert (exit_code, err) == (130, "")
        assert "lockstep  40 SYNCs of 1000 us: 0.040 s" in out
        traces.append((bench.directory / "trace.log").read_bytes())
    assert frames[0] == frames[1]
    assert traces[0] == traces[1]
    assert traces[0].count(b"080#") == 40


@pytest.mark.long
def test_a_controller_that_is_gone_leaves_time_to_the_next_one(start):
    bench = start("bench")
    first = Controller(bench.port)
    first.say(0x000, b"\x01\x00")
    for _ in range(10):
        first.cycle()
        first.await_answer()
    first.say(0x601, bytes.fromhex("2114630102000000"))  # begins a download, and is gone
    first.close()
    second = Controller(bench.port)
    second.cycle(0)
    second.await_answer()
    second.close()
    exit_code, out, _ = bench.end(signal.SIGINT)  # while nobody lets time pass
    assert exit_code == 130
    assert "lockstep  11 SYNCs of 1000 us: 0.011 s" in out
    assert "node 1    valve: OPERATIONAL" in out


@pytest.mark.long
def test_a_controller_on_two_buses_moves_a_bench_on_each(start):
    benches = [start(name) for name in ("left", "right")]
    buses = [Controller(bench.port) for bench in benches]
    for number in range(20):
        for bus, count in zip(buses, (1, 2), strict=True):  # the right one at twice the rate
            for _ in range(count):
                bus.cycle()
                answer = bus.await_answer()[-1]
                assert answer[1].startswith(b"43001000"), number
    for bus in buses:
        bus.close()
    outputs = [bench.end()[1] for bench in benches]
    assert "lockstep  20 SYNCs of 1000 us: 0.020 s" in outputs[0]
    assert "lockstep  40 SYNCs of 1000 us: 0.040 s" in outputs[1]
