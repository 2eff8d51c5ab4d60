"""What a controller and its bus may do to a bench in lock-step; the machine's clock is a fake one.

No SYNC, no time: neither the valve nor a time-out moves while the controller is away, and all of it
goes on from there. What is safe in bench time is so at every speed.
"""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.any_frame import ANY_FRAME
from support.bus_side import (
    CONTROLLER,
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    START_ALL,
    SYNC,
    VALVE,
    download_request,
    valve_command,
)

from hil_bench import BusError, load_config
from hil_bench.abilities.lockstep.lockstep import LockStep, run_lockstep
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.transports.transport import TransportCounters

TICK = 1_000_000  # [ns]
SECOND = 1_000_000_000
NODES = (VALVE, PRESSURE_A, PRESSURE_B, POSITION)
RPDO_TIMED_OUT, HEARTBEAT_LOST = 0x8250, 0x8130  # EMCY codes of CiA 301
HALF_OPEN = 8192  # 50 %
FULL_OPENING = 1.3e-3  # alpha + beta of Table I [m]
SETTLED = 15  # ticks, see test_valve_safety.py
TIMEOUT = 50  # of the RPDO [ms], and so ticks and SYNCs
READ_DEVICE_TYPE = Frame(0x604, bytes.fromhex("4000100000000000"))
READ_HOLD_SETPOINT = Frame(0x601, bytes.fromhex("4014630100000000"))
HOLD_SETPOINT_0 = bytes.fromhex("4B14630100000000")

STANDSTILL = (
    "scripted: no SYNC (0x080) for 5 s; bench time stands still at {:.3f} s, and so do time-outs "
    "and valve"
)

SET_UP = (
    *(download_request(node_id, 0x1800, 2, b"\x01") for node_id in NODES),  # with each SYNC
    download_request(VALVE, 0x1400, 5, struct.pack("<H", TIMEOUT)),
    START_ALL,
)
DRIVE = (valve_command(7, HALF_OPEN), SYNC)


class Script:
    """A bus that brings frames, is silent for as many seconds as a number says, and then is lost.

    Each wait takes what it was asked to wait at most, on the fake clock.
    """

    description = "scripted"

    def __init__(self, clock, items):
        self.clock = clock
        self.items = list(items)
        self.sent = []

    def wait(self, timeout):
        if not self.items:
            raise BusError("scripted: all is said")
        if isinstance(self.items[0], Frame):
            return True
        self.clock.advance(round(timeout * SECOND))
        self.items[0] -= timeout
        if self.items[0] <= 0:
            self.items.pop(0)
        return False

    def receive(self, limit):
        frames = []
        while len(frames) < limit and self.items and isinstance(self.items[0], Frame):
            frames.append(self.items.pop(0))
        return frames

    def send(self, frames):
        self.sent += [(self.clock.now(), frame) for frame in frames]

    def counters(self):
        return TransportCounters(sent=len(self.sent))


class Session:
    """A run in lock-step, over.

    Attributes:
        report: what the run says.
        sent: frames of the bench, in order.
        spools: spool positions after each tick, as fractions of full opening.
        script: the bus.
    """

    def __init__(self, items):
        clock = VirtualClock()
        self.script = Script(clock, items)
        self.spools = []
        session = open_session(load_config())
        plant = session.bench.axes[0].plant
        session.start()
        session.tick([], 0)
        session.watch(ticks=lambda _now: self.spools.append(plant.output.nu / FULL_OPENING))
        lockstep = LockStep(session, tick_ns=TICK)
        self.report = run_lockstep(lockstep, self.script, stopped=lambda: False, clock=clock)
        self.sent = [frame for _, frame in self.script.sent]

    def of(self, can_id):
        return [frame.data for frame in self.sent if frame.can_id == can_id]


def test_each_sync_of_a_storm_is_a_period_and_none_is_a_sign_of_life():
    session = Session([*SET_UP, *DRIVE * 60, *[SYNC] * 3000])
    assert (session.report.syncs, session.report.now) == (3060, 3060 * TICK)
    assert str(session.report.lost) == "scripted: all is said"
    for node_id in NODES:
        assert len(session.of(0x180 + node_id)) == 3060
    assert session.spools[59] == pytest.approx(0.5, rel=1e-3)
    (emergency,) = session.of(0x081)
    assert struct.unpack_from("<H", emergency)[0] == RPDO_TIMED_OUT
    # The last RPDO came at 59 ms, so the tick of 109 ms, the 109th, has it timed out.
    assert session.spools[59 + TIMEOUT - 2] == pytest.approx(0.5, rel=1e-3)
    assert abs(session.spools[59 + TIMEOUT - 1]) < 0.4
    assert max(map(abs, session.spools[59 + TIMEOUT + SETTLED :])) < 1e-3


def test_a_sync_that_stops_for_a_minute_is_told_and_changes_nothing(caplog):
    before, after = [*SET_UP, *DRIVE * 100], [*DRIVE * 100]
    session = Session([*before, 60.0, *after])
    assert caplog.messages == [
        STANDSTILL.format(0.1),
        "scripted: SYNC has come after 60.0 s; bench time goes on",
    ]
    undisturbed = Session([*before, *after])
    assert session.sent == undisturbed.sent
    assert session.spools == undisturbed.spools
    assert session.report.now == 200 * TICK


def test_what_needs_no_time_is_answered_while_sync_is_away(caplog):
    session = Session([*SET_UP, *DRIVE * 10, 30.0, READ_DEVICE_TYPE, 30.0])
    assert session.of(0x584)[-1][:4] == bytes.fromhex("43001000")
    assert session.report.now == 10 * TICK
    # It is SYNC that is missed, and it is said once.
    assert len(caplog.messages) == 1


def test_a_controller_that_never_sends_sync_is_told(caplog):
    Session([3.0, *SET_UP, 3.0])
    assert caplog.messages == [STANDSTILL.format(0.0)]


def test_short_silences_are_nobodys_business(caplog):
    Session([4.5, *SET_UP, SYNC, 4.5, SYNC, 4.5, SYNC])
    assert caplog.messages == []


TRANSFERS = {
    "segmented": [Frame(0x601, bytes.fromhex("2114630102000000"))],  # download of two bytes
    "block": [
        Frame(0x601, bytes.fromhex("C214630102000000")),  # as a block; then its only segment
        Frame(0x601, bytes.fromhex("8100100000000000")),
    ],
}


@pytest.mark.parametrize("transfer", TRANSFERS.values(), ids=TRANSFERS)
def test_a_controller_that_dies_in_a_transfer_is_followed_by_the_next(transfer):
    heartbeat = Frame(0x700 + CONTROLLER, b"\x05")
    watch = download_request(VALVE, 0x1016, 1, struct.pack("<I", CONTROLLER << 16 | TIMEOUT))
    driven = [*SET_UP, watch, heartbeat, *DRIVE * 40, *transfer, 60.0]
    session = Session([*driven, READ_HOLD_SETPOINT, *[SYNC] * 2000])
    # As long as no SYNC comes, the next controller finds everything as it was left.
    answers = session.of(0x581)
    assert HOLD_SETPOINT_0 in answers
    (emergency,) = session.of(0x081)
    assert struct.unpack_from("<H", emergency)[0] == HEARTBEAT_LOST
    assert max(map(abs, session.spools[40 + TIMEOUT + SETTLED :])) < 1e-3

    nobody = Session([*driven, *[SYNC] * 2000])
    assert nobody.of(0x581)[-1] == bytes.fromhex("8014630100000405")  # 0504 0000, timed out


@settings(max_examples=30)
@given(st.lists(ANY_FRAME, max_size=60))
def test_garbage_moves_time_by_its_syncs_and_stops_nothing(garbage):
    revive = Frame(0x000, b"\x81\x00")  # NMT: reset all nodes
    session = Session([*SET_UP, *garbage, revive, *[SYNC] * 3, READ_DEVICE_TYPE])
    syncs = sum(f == SYNC._replace(data=f.data) for f in garbage)
    assert (session.report.syncs, session.report.now) == (3 + syncs, (3 + syncs) * TICK)
    assert str(session.report.lost) == "scripted: all is said"
    assert max(map(abs, session.spools)) < 1.1
    is_configured = not any(frame.can_id == 0x7E5 for frame in garbage)
    assert not is_configured or session.of(0x584)[-1][:4] == bytes.fromhex("43001000")
