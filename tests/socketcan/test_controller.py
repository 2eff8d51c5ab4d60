"""The example controller and the bench, two processes that know of each other by frames only."""

import re
import struct
import sys
from pathlib import Path

import pytest

from hil_bench.cli.exit_codes import ExitCode

CONTROLLER = Path(__file__).parents[2] / "examples" / "position_control.py"
CONTROLLER_NODE = 127  # its default
SYNC, VALVE_EMCY, VALVE_STATUS, VALVE_COMMAND, VALVE_REQUEST = 0x080, 0x081, 0x181, 0x201, 0x601
POSITION = 0x184  # 0x6004 in steps of 1 µm
CYCLES_AT_REST, MOST_CYCLES = 100, 4000  # 0.5 s and 20 s
FULL_SCALE = 16384  # 100 % in 0x6300 and 0x6301
RPDO_TIMED_OUT, HEARTBEAT_LOST = 0x8250, 0x8130  # EMCY codes of CiA 301
SYNC_PERIOD = 0.010  # [s]
PATIENCE = 2.0  # [s]; a busy machine lets a User-Mode Linux stand still for 0.1 s and more


@pytest.fixture
def start_controller(start, channel):
    """Start the controller; a cycle of 5 ms leaves one processor time for the bench and for us."""

    def start_it(*arguments):
        bus = "-i", "socketcan", "-c", channel
        pace = "--period-ms", 5, "--patience-ms", round(PATIENCE * 1000)
        return start(sys.executable, CONTROLLER, *bus, *pace, *arguments)

    return start_it


def spool(data):
    return struct.unpack_from("<h", data, 2)[0]


def is_centred(data):
    return abs(spool(data)) <= FULL_SCALE // 100


def emergency_code(data):
    return struct.unpack_from("<H", data)[0]


def test_the_position_loop_settles(start_bench, start_controller, cansend, watch):
    bench = start_bench()
    controller = start_controller("--waypoints-mm", 50, "--duration", 1000)

    # At rest the controller leaves an error of up to 50 µm alone (`tolerance`); as much again for
    # what the piston still moves until it rests, which takes a busy machine its time.
    at_rest = 0
    for _ in range(MOST_CYCLES):
        (position,) = struct.unpack_from("<i", watch.wait_for(POSITION).data)
        at_rest = at_rest + 1 if abs(position - 50_000) <= 100 else 0
        if at_rest == CYCLES_AT_REST:
            break
    else:
        pytest.fail(f"not at rest at 50 mm after {MOST_CYCLES} cycles: {position} um")
    ended = controller.stop()
    assert ended.exit_code == ExitCode.INTERRUPTED, ended

    watch.take_all()
    cansend("604#4004600000000000")  # where is the piston now? 0x6004 in steps of 1 µm
    answer = bytes(watch.wait_for(0x584).data)
    assert answer[:4] == bytes.fromhex("43046000")
    assert struct.unpack_from("<i", answer, 4)[0] == pytest.approx(50_000, abs=100)
    assert bench.stop().exit_code == ExitCode.INTERRUPTED


def test_candump_sees_the_session(start_bench, start_controller, start, cansend, channel):
    candump = start("candump", "-L", "-r", 8 * 1024 * 1024, channel)
    while not candump.output():  # candump does not say when it listens
        cansend("7FF#")
    start_bench()
    ended = start_controller("--duration", 1).wait()
    assert ended.exit_code == 0, ended

    log = re.findall(rf"{channel} ([0-9A-F]{{3}})#([0-9A-F]*)", candump.stop().stdout)
    frames = [(int(can_id, 16), data) for can_id, data in log]
    for node_id in (1, 2, 3, 4):
        of_node = [frame for frame in frames if frame[0] & 0x7F == node_id and frame[0] != 0x600]
        assert of_node[0] == (0x700 + node_id, "00")  # the boot-up comes first
        assert (0x700 + node_id, "05") in of_node  # heartbeat: OPERATIONAL
        assert any(can_id == 0x180 + node_id for can_id, _ in of_node)  # TPDO 1
    seen = {can_id for can_id, _ in frames}
    assert {0x000, SYNC, VALVE_COMMAND, VALVE_REQUEST, 0x700 + CONTROLLER_NODE} <= seen


def test_a_killed_controller_leaves_the_spool_at_its_centre(
    start_bench, start_controller, start, watch, channel
):
    start_bench()
    # A second SYNC, at which the valve tells its spool position once the controller's has died. It
    # begins before, since a program may take longer to start than the heartbeat is waited for.
    start("cangen", channel, "-I", f"{SYNC:03X}", "-L", 0, "-g", round(SYNC_PERIOD * 1000))
    watch.wait_for(SYNC)
    controller = start_controller()
    # Expedited download of two bytes to 0x1400.05: the time-out that the driver chose [ms].
    request = watch.wait_for(VALVE_REQUEST, lambda data: data[:4] == bytes.fromhex("2B001405"))
    assert struct.unpack_from("<H", request.data, 4)[0] == round(PATIENCE * 1000)
    watch.wait_for(VALVE_STATUS, lambda data: abs(spool(data)) > FULL_SCALE // 4)
    controller.kill()

    timed_out = watch.wait_for(VALVE_EMCY)
    assert emergency_code(timed_out.data) == RPDO_TIMED_OUT
    # The bench dates a frame by the scheduled time of the tick that takes it. A tick that was held
    # up takes frames that came after that time, and then counts them that much too early.
    assert timed_out.timestamp - watch.last(VALVE_COMMAND).timestamp > PATIENCE / 2
    watch.wait_for(VALVE_STATUS, is_centred)

    # The lost heartbeat, twice as late, takes the node to PRE-OPERATIONAL (CiA 301, 0x1029).
    seen = len(watch.frames)
    watch.wait_for(VALVE_EMCY, lambda data: emergency_code(data) == HEARTBEAT_LOST)
    statuses = [f.data for f in watch.frames[seen:] if f.arbitration_id == VALVE_STATUS]
    assert statuses
    assert all(map(is_centred, statuses))
