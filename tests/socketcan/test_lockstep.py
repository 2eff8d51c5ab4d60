"""Lock-step on real SocketCAN: two processes, and the same bytes at every run."""

import subprocess
from pathlib import Path

import can
import pytest
from support.can_link import await_frame, send, set_link

from hil_bench.pytest_plugin.firmware import FirmwareBus
from hil_bench.virtual_bench import VirtualBench

EXAMPLE = Path(__file__).parents[2] / "examples" / "firmware"


@pytest.fixture(scope="module")
def controller(tmp_path_factory):
    build = tmp_path_factory.mktemp("build")
    subprocess.run(["make", "--silent", "-C", EXAMPLE, f"BUILD={build}"], check=True)
    return build / "position_control"


def frames_of_a_session(controller, channel, directory):
    with VirtualBench() as bench:
        bus = FirmwareBus(bench, channel, is_realtime=False)
        try:
            command = [controller, "--bus", "{bus}", "--lockstep", "--targets-mm", "10"]
            assert bus.start(command, directory).wait(timeout=5.0) == 0
        finally:
            bus.close()
        return list(bench.frames)


def test_two_sessions_are_the_same(controller, channel, tmp_path):
    frames = frames_of_a_session(controller, channel, tmp_path)
    assert len(frames) > 1000
    assert frames_of_a_session(controller, channel, tmp_path) == frames


def drive(channel, cycles):
    """Let a controller send SYNCs, each with an SDO request whose answer it waits for."""
    with can.Bus(interface="socketcan", channel=channel) as bus:
        for _ in range(cycles):
            send(bus, 0x080)
            send(bus, 0x604, bytes.fromhex("4000100000000000"))
            await_frame(bus, 0x584)


@pytest.fixture
def bench(start, own_channel):
    """A bench in lock-step on an interface of its own, listening."""
    program = start("hil-bench", "run", "-i", "socketcan", "-c", own_channel, "--lockstep")
    program.wait_for_output("node 4")
    return program


def test_an_interface_that_goes_down_and_up_is_outlasted(bench, own_channel):
    drive(own_channel, 10)
    set_link(own_channel, "down")
    bench.wait_for_error("is down")
    set_link(own_channel, "up")
    bench.wait_for_error("is up again")
    drive(own_channel, 10)
    ended = bench.stop()
    assert ended.exit_code == 130, ended
    assert "lockstep  20 SYNCs of 1000 us: 0.020 s" in ended.stdout  # from where it was
    assert "1 times the interface went down" in ended.stdout


def test_one_that_is_down_at_the_end_is_a_lost_bus(bench, own_channel):
    drive(own_channel, 10)
    set_link(own_channel, "down")
    bench.wait_for_error("is down")
    ended = bench.stop()
    assert ended.exit_code == 3, ended
    assert ended.stderr.splitlines()[-1].endswith("the interface was down at the end")
    assert "lockstep  10 SYNCs" in ended.stdout
