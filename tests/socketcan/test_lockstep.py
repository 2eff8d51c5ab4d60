"""Lock-step on real SocketCAN: two processes, and the same bytes at every run."""

import can
import pytest
from support.can_link import await_frame, send, set_link
from support.firmware import build_controller, run_session


def test_two_sessions_are_the_same(channel, tmp_path):
    controller = build_controller(tmp_path)
    (frames, _), (again, _) = (run_session(controller, channel, "10", tmp_path) for _ in range(2))
    assert len(frames) > 1000
    assert again == frames


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
