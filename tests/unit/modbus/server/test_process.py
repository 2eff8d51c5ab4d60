"""The server in its own process, behind a loop that is this test."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support.modbus_loop import make_binding, ticking
from support.patience import GUARD

from hil_bench.abilities.modbus.server.process import ModbusProcess
from hil_bench.errors import BusError

READ = bytes.fromhex("0001 0000 0006 02 04 0000 0004")


def ask(port, request, size):
    with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
        connection.sendall(request)
        connection.settimeout(GUARD)
        data = b""
        while len(data) < size and (piece := connection.recv(size - len(data))):
            data += piece
    return data


def test_values_and_writes_cross_the_process(tmp_path):
    side, binding = make_binding(tmp_path, extra='serial_port = "pty"')
    with ModbusProcess(binding.plan) as server, ticking(side, binding):
        port = server.endpoints.port
        assert Path(server.endpoints.serial_port).exists()
        assert server.alive
        write = bytes.fromhex("0002 0000 0006 02 06 0001 0007")
        assert ask(port, write, 12) == write
        back = ask(port, bytes.fromhex("0003 0000 0006 02 03 0001 0001"), 11)
        assert back == bytes.fromhex("0003 0000 0005 02 03 02 0007")
        first, second = (int.from_bytes(ask(port, READ, 17)[13:], "big") for _ in range(2))
        assert 0 < first <= second
    assert not server.alive


def test_the_server_lives_on_where_the_loop_publishes_nothing(tmp_path):
    _, binding = make_binding(tmp_path)
    with ModbusProcess(binding.plan) as server:
        answer = ask(server.endpoints.port, READ, 9)
        assert answer == bytes.fromhex("0001 0000 0003 02 84 04")


def test_a_server_that_died_is_started_again_at_its_port(tmp_path):
    side, binding = make_binding(tmp_path, extra='serial_port = "pty"')
    write = bytes.fromhex("0002 0000 0006 02 06 0001 0007")
    with ModbusProcess(binding.plan) as server:
        with ticking(side, binding):
            port = server.endpoints.port
            assert ask(port, write, 12) == write
        # The loop stands still, so this one is under way when the server dies.
        with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
            connection.sendall(bytes.fromhex("0002 0000 0006 02 06 0001 0008"))
            while binding.plan.mailbox._number_at(2) != 2:
                pass
            os.kill(server.pid, signal.SIGKILL)
            connection.settimeout(GUARD)
            assert connection.recv(1) == b""
        server.restart()
        assert server.alive
        assert server.endpoints.port == port
        assert Path(server.endpoints.serial_port).exists()
        with ticking(side, binding):
            assert ask(port, write, 12) == write
            back = ask(port, bytes.fromhex("0003 0000 0006 02 03 0001 0001"), 11)
            assert back == bytes.fromhex("0003 0000 0005 02 03 02 0007")
        # Three writes, three orders, each obeyed once: the last one is the third.
        assert binding.plan.mailbox._taken == 3


def test_a_port_in_use_is_a_line(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        _, binding = make_binding(tmp_path, port)
        with pytest.raises(BusError) as caught, ModbusProcess(binding.plan):
            pass
    assert str(caught.value) == (
        f"modbus 127.0.0.1:{port}: the port is in use; "
        "give another port, or end the program that has it"
    )


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ('host = "192.0.2.1"', "modbus 192.0.2.1:0: this machine has no such address"),
        ('serial_port = "/dev/nothing"', "modbus serial port /dev/nothing: cannot be opened"),
    ],
)
def test_what_cannot_be_had_is_a_line(tmp_path, extra, message):
    _, binding = make_binding(tmp_path, extra=extra)
    with pytest.raises(BusError) as caught, ModbusProcess(binding.plan):
        pass
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_ctrl_c_is_left_to_the_parent(tmp_path):
    side, binding = make_binding(tmp_path)
    with ModbusProcess(binding.plan) as server, ticking(side, binding):
        os.kill(server.pid, signal.SIGINT)
        assert len(ask(server.endpoints.port, READ, 17)) == 17


PARENT = """
import sys
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.server.process import ModbusProcess

if __name__ == "__main__":
    config = load_config(sys.argv[1])
    with ModbusProcess(ModbusBinding(config, build_bench(config)).plan) as server:
        print(server.endpoints.port, flush=True)
        sys.stdin.read()
"""


@pytest.mark.long
def test_the_server_ends_with_its_parent(tmp_path, make_file):
    make_binding(tmp_path)
    program = make_file("parent.py", PARENT)
    command = [sys.executable, str(program), str(tmp_path / "bench.toml")]
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        port = int(parent.stdout.readline())
        with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as connection:
            parent.kill()
            connection.settimeout(GUARD)
            assert connection.recv(1) == b""  # closed, as the process is gone
