"""How a bench on a bus ends, and how it does not start."""

import signal

import can
import pytest
from support.can_link import await_frame, send, set_link

from hil_bench.cli.exit_codes import ExitCode

NMT_START_ALL = "000#0100"
BOOT_UP = 0x704
POSITION = 0x184  # TPDO 1 of node 4, event timer 10 ms
ACTIVE, FAULT_HOLD = 0x0F, 0x03  # low bits of the CiA 408 status word


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_within_a_few_ticks(start_bench, cansend, watch, number):
    bench = start_bench()
    cansend(NMT_START_ALL)
    watch.wait_for(POSITION)
    watch.take_all()
    ended = bench.stop(number)
    assert ended.exit_code == ExitCode.INTERRUPTED
    # The line of the nodes' new state comes within 0.1 s, before the signal or not at all.
    assert [line for line in ended.stderr.splitlines() if "OPERATIONAL" not in line] == []
    assert "summary\nticks" in ended.stdout
    # One each 10 ms, so this says 20 ms; one more may have been under way.
    assert sum(frame.arbitration_id == POSITION for frame in watch.take_all()) <= 3


def test_a_duration_ends_the_run_by_itself(start_bench):
    ended = start_bench("--duration", "0.5").wait()
    assert (ended.exit_code, ended.stderr) == (ExitCode.DONE, "")
    assert "ticks     500 of 1000 us" in ended.stdout


def test_a_missing_interface_is_told_in_one_line(start):
    ended = start("hil-bench", "run", "-i", "socketcan", "-c", "vcan9").wait()
    assert (ended.exit_code, ended.stderr.count("\n")) == (ExitCode.BUS, 1), ended
    assert "vcan9" in ended.stderr


def test_an_interface_that_goes_down_and_up_is_outlasted(start, own_channel):
    bench = start("hil-bench", "run", "-i", "socketcan", "-c", own_channel)
    with can.Bus(interface="socketcan", channel=own_channel) as bus:
        await_frame(bus, BOOT_UP)
        send(bus, 0x601, bytes.fromhex("2b00140564000000"))  # 0x1400.05: RPDO time-out 100 ms
        await_frame(bus, 0x581)
        send(bus, 0x000, b"\x01\x00")
        send(bus, 0x201, bytes.fromhex("07000020"))  # enabled, 50 %
        await_frame(bus, POSITION)
    set_link(own_channel, "down")
    bench.wait_for_error("is down")
    set_link(own_channel, "up")
    with can.Bus(interface="socketcan", channel=own_channel) as bus:
        await_frame(bus, POSITION)
        status = ACTIVE
        while status != FAULT_HOLD:  # the valve watches its RPDO whether there is a bus or not
            send(bus, 0x601, bytes.fromhex("4041600000000000"))
            status = await_frame(bus, 0x581)[4] & 0x0F
            assert status in {ACTIVE, FAULT_HOLD}
    bench.wait_for_error("is up again")  # it looks now and then; its frames may be out before
    ended = bench.stop()
    assert ended.exit_code == ExitCode.INTERRUPTED, ended
    down, up = [line for line in ended.stderr.splitlines() if own_channel in line]
    assert f"'ip link set {own_channel} up' starts it; the bench goes on without it" in down
    assert up == f"hil-bench: socketcan {own_channel}: the interface is up again"
    assert "1 times the interface went down" in ended.stdout


def test_an_interface_that_is_down_at_the_end_is_a_lost_bus(start, own_channel):
    bench = start("hil-bench", "run", "-i", "socketcan", "-c", own_channel)
    with can.Bus(interface="socketcan", channel=own_channel) as bus:
        await_frame(bus, BOOT_UP)
    set_link(own_channel, "down")
    bench.wait_for_error("is down")
    ended = bench.stop()
    assert ended.exit_code == ExitCode.BUS, ended
    assert ended.stderr.splitlines()[-1].endswith("the interface was down at the end")
    assert "summary\nticks" in ended.stdout
