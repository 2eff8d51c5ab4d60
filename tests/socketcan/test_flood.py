"""Floods from ``cangen`` at the full rate that it reaches, far above what a CAN bus can carry."""

import re
import struct
import subprocess

import pytest

FRAMES = 20_000  # as many as the bench's receive buffer holds, were none of them read meanwhile
NMT_START_ALL = "000#0100"
VALVE_EMCY, VALVE_STATUS, VALVE_ANSWER, POSITION = 0x081, 0x181, 0x581, 0x184
READ_DEVICE_TYPE = "4000100000000000"
DEVICE_TYPE_408 = bytes.fromhex("43001000") + struct.pack("<I", 408)
SHORT_RPDO = "0700"  # the control word alone; mapped are four bytes
RPDO_TOO_SHORT = bytes.fromhex("1082110000000000")  # EMCY 0x8210; generic, communication error
INIT, ACTIVE = 0x08, 0x0F  # low byte of the CiA 408 status word


@pytest.fixture
def started_bench(start_bench, cansend, watch):
    """A bench with its nodes OPERATIONAL; from here on the watcher hears the devices alone."""
    bench = start_bench()
    watch.listen_to(VALVE_EMCY, VALVE_STATUS, VALVE_ANSWER, POSITION)
    cansend(NMT_START_ALL)
    watch.wait_for(POSITION)
    return bench


def flood(channel, *arguments):
    """Send frames without a pause, until all are sent."""
    subprocess.run(["cangen", channel, "-g", "0", *arguments], check=True)


def figure(pattern, ended):
    """Return a figure of the summary."""
    found = re.search(pattern, ended.stdout)
    assert found, ended
    return int(found[1])


def check_that_nothing_was_lost(ended):
    """No frame was dropped on the way in or out.

    That a flood costs no tick either is shown on a clock that jumps, in
    tests/unit/session/test_paced.py: here one slow processor may have to do the flood, the bench
    and the watcher.
    """
    assert ended.exit_code == 130, ended
    assert "dropped" not in ended.stdout


@pytest.mark.parametrize("identifier", [["-I", "123"], ["-e", "-I", "r"]], ids=["11bit", "29bit"])
def test_foreign_frames_change_nothing(started_bench, cansend, channel, watch, identifier):
    flood(channel, *identifier, "-L", "8", "-n", str(FRAMES))
    cansend("601#" + READ_DEVICE_TYPE)  # behind the flood, so the answer says it is over
    assert bytes(watch.wait_for(VALVE_ANSWER).data) == DEVICE_TYPE_408
    watch.wait_for(POSITION)  # the cyclic reports go on
    ended = started_bench.stop()

    check_that_nothing_was_lost(ended)
    # The kernel's filter kept the flood away: what came in is our two frames.
    assert figure(r"(\d+) received", ended) == 2


def test_every_sdo_request_of_a_flood_is_answered(started_bench, channel, watch):
    flood(channel, "-I", "601", "-L", "8", "-D", READ_DEVICE_TYPE, "-n", str(FRAMES))
    answers = {bytes(watch.wait_for(VALVE_ANSWER).data) for _ in range(FRAMES)}
    watch.wait_for(POSITION)  # the cyclic reports go on
    ended = started_bench.stop()

    assert answers == {DEVICE_TYPE_408}
    assert figure(r"(\d+) received", ended) == FRAMES + 1
    check_that_nothing_was_lost(ended)


def test_a_flood_of_short_rpdos_is_reported_and_not_obeyed(started_bench, cansend, channel, watch):
    flood(channel, "-I", "201", "-L", "2", "-D", SHORT_RPDO, "-n", str(FRAMES))
    cansend("201#07000000")  # the first whole one
    watch.wait_for(VALVE_STATUS, lambda data: data[0] == ACTIVE)
    ended = started_bench.stop()

    assert figure(r"(\d+) short rpdos", ended) == FRAMES
    emergencies = [bytes(f.data) for f in watch.frames if f.arbitration_id == VALVE_EMCY]
    assert emergencies == [RPDO_TOO_SHORT]  # an error is told when it appears, not each time
    states = {f.data[0] for f in watch.frames if f.arbitration_id == VALVE_STATUS}
    assert states == {INIT, ACTIVE}
    check_that_nothing_was_lost(ended)
