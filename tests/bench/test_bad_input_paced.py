"""What a controller, its bus and its machine may do to a paced run, on a clock that jumps.

Each time the bench keeps its grid, says what happened, and the valve goes to its centre: within
`SETTLED` of the fault (see test_valve_safety.py). That a lost bus is exit code 3 is shown in
tests/unit/cli/test_run.py, the same on a real interface in tests/socketcan.
"""

import struct
from collections import Counter

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
    BusSide,
    download_request,
    valve_command,
)

from hil_bench.bench.configuration import load_config
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import TransportCounters

MS = 1_000_000  # [ns]
SECOND = 1000 * MS
NODES = (VALVE, PRESSURE_A, PRESSURE_B, POSITION)
VALVE_EMCY, VALVE_STATUS, VALVE_ANSWER = 0x081, 0x181, 0x581
RPDO_TIMED_OUT, HEARTBEAT_LOST = 0x8250, 0x8130  # EMCY codes of CiA 301
ACTIVE, FAULT_HOLD = 0x0F, 0x03  # low bits of the CiA 408 status word
HALF_OPEN = 8192  # 50 %
FULL_OPENING = 1.3e-3  # alpha + beta of Table I [m]
SETTLED = 15 * MS
TIMEOUT = 50 * MS  # of the RPDO, and of the controller's heartbeat
READ_DEVICE_TYPE = Frame(0x601, bytes.fromhex("4000100000000000"))
DEVICE_TYPE_408 = Frame(0x581, bytes.fromhex("4300100098010000"))

SET_UP = (
    *(download_request(node_id, 0x1800, 2, b"\x01") for node_id in NODES),  # with each SYNC
    download_request(VALVE, 0x1400, 5, struct.pack("<H", TIMEOUT // MS)),
    START_ALL,
)


class Wire:
    """A bus that brings each frame at its time; taking one costs some of the tick's."""

    description = "wire"
    has_exact_wait = False

    def __init__(self, clock, arrivals, cost=0):
        self.clock = clock
        self.arrivals = list(arrivals)
        self.cost = cost
        self.sent = []

    def receive(self, limit):
        count = sum(time <= self.clock.now() for time, _ in self.arrivals[:limit])
        taken, self.arrivals = self.arrivals[:count], self.arrivals[count:]
        self.clock.advance(self.cost * count)
        return [frame for _, frame in taken]

    def send(self, frames):
        self.sent += [(self.clock.now(), frame) for frame in frames]

    def listen_to(self, can_ids):
        pass

    def counters(self):
        return TransportCounters()


class Session:
    """A run of the bench on a wire, over.

    Attributes:
        report: what the run says.
        sent: frames of the bench with the times at which they were sent.
        spools: spool positions by the scheduled time of the tick, as fractions of full opening.
        waiting: what was left on the wire.
    """

    def __init__(self, arrivals, *, until, config=None, clock=None, cost=0):
        config = config or load_config()
        clock = clock or VirtualClock()
        wire = Wire(clock, arrivals, cost)
        pacer = Pacer(clock, config.tick_ns)
        self.spools = {}

        session = open_session(config)
        plant = session.bench.axes[0].plant

        def observe(now):
            self.spools[now] = plant.output.nu / FULL_OPENING

        session.watch(ticks=observe)
        self.report = run_paced(session, wire, pacer, stopped=lambda: clock.now() >= until)
        self.sent = wire.sent
        self.waiting = wire.arrivals

    def times_of(self, can_id):
        return [time for time, frame in self.sent if frame.can_id == can_id]

    def emergencies(self):
        """Return times and codes of the valve's EMCY, those that tell of an error."""
        codes = [
            (time, struct.unpack_from("<H", frame.data)[0])
            for time, frame in self.sent
            if frame.can_id == VALVE_EMCY
        ]
        return [(time, code) for time, code in codes if code]

    def statuses(self):
        """Return the low bits of the valve's status word by the times of its TPDOs."""
        return {time: f.data[0] & 0x0F for time, f in self.sent if f.can_id == VALVE_STATUS}

    def is_centred(self, begin, end):
        spools = [abs(spool) for time, spool in self.spools.items() if begin <= time < end]
        assert spools
        return max(spools) < 1e-3


def every(period, begin, end, *frames):
    """Yield frames with their times, from `begin` to before `end`."""
    for time in range(begin, end, period):
        yield from ((time, frame) for frame in frames)


def at(time, *frames):
    return [(time, frame) for frame in frames]


def test_a_sync_storm_costs_no_tick_and_hides_no_controller_that_died():
    driving = every(MS, 5 * MS, 101 * MS, valve_command(7, HALF_OPEN), SYNC)
    # 25 in a ms are more than a bus of 1 Mbit/s carries (47 bits each); each takes 20 us here.
    storm = every(MS // 25, 101 * MS, 300 * MS, SYNC)
    session = Session([*at(2 * MS, *SET_UP), *driving, *storm], until=300 * MS, cost=20_000)

    ticks = session.report.ticks
    assert (ticks.ticks, ticks.overruns, ticks.skipped) == (300, 0, 0)
    assert session.spools[100 * MS] == pytest.approx(0.5, rel=1e-3)
    # The last RPDO was taken by the tick at 100 ms: SYNC is no sign of life.
    ((time, code),) = session.emergencies()
    assert (time // MS, code) == (100 + TIMEOUT // MS, RPDO_TIMED_OUT)
    assert session.is_centred(150 * MS + SETTLED, 300 * MS)
    for node_id in NODES:  # each SYNC has one TPDO of each device, however many a tick takes
        times = Counter(time // MS for time in session.times_of(0x180 + node_id))
        assert [times[tick] for tick in range(102, 300)] == [25] * 198


@pytest.fixture
def slow_config(load_bench):
    """A tick of 10 ms in twenty steps, so that a minute takes 6000 of them."""
    return load_bench("[bench]\ntick_us = 10000\nstep_us = 500\n")


SYNCHRONOUS_RPDO = download_request(VALVE, 0x1400, 2, b"\x01")
MINUTE = 60 * SECOND


def test_a_sync_that_stops_for_a_minute_finds_valve_and_phase_as_they_should_be(slow_config):
    stop, back = SECOND, SECOND + MINUTE
    driving = [valve_command(7, HALF_OPEN), SYNC]
    arrivals = [
        *at(20 * MS, *SET_UP, SYNCHRONOUS_RPDO),
        *every(10 * MS, 50 * MS, stop, *driving),
        # A fault is reset by the rising edge of R, and the word after that enables (CiA 408).
        *at(back, valve_command(0x0F, 0), SYNC),
        *every(10 * MS, back + 10 * MS, back + SECOND, *driving),
    ]
    session = Session(arrivals, until=back + SECOND, config=slow_config)

    ticks = session.report.ticks
    assert (ticks.ticks, ticks.skipped) == ((MINUTE + 2 * SECOND) // (10 * MS), 0)
    assert session.spools[stop - 10 * MS] == pytest.approx(0.5, rel=1e-3)
    ((time, code),) = session.emergencies()
    assert (time, code) == (stop - 10 * MS + TIMEOUT, RPDO_TIMED_OUT)
    # No TPDO without SYNC; the first SYNC after it is answered by the tick that takes it.
    statuses = session.statuses()
    assert [time for time in statuses if stop <= time < back] == []
    assert statuses[back] != ACTIVE
    assert statuses[back + 20 * MS] == ACTIVE
    assert session.is_centred(time + SETTLED, back + 10 * MS)
    assert session.spools[back + SECOND - 10 * MS] == pytest.approx(0.5, rel=1e-3)


def test_where_sync_alone_stops_the_last_synchronous_set_point_stays(slow_config):
    """As CiA 301 has it: RPDOs that come are no reason for a time-out, and act with SYNC only."""
    stop, back = SECOND, 2 * SECOND
    arrivals = [
        *at(20 * MS, *SET_UP, SYNCHRONOUS_RPDO),
        *every(10 * MS, 50 * MS, stop, valve_command(7, HALF_OPEN), SYNC),
        *every(10 * MS, stop, back, valve_command(7, 0)),
        *at(back, SYNC),
    ]
    session = Session(arrivals, until=back + 40 * MS, config=slow_config)
    assert session.emergencies() == []
    assert session.spools[back - 10 * MS] == pytest.approx(0.5, rel=1e-3)
    assert session.is_centred(back + 2 * SETTLED, back + 40 * MS)


TRANSFERS = {
    "segmented": [Frame(0x601, bytes.fromhex("2114630102000000"))],  # download of two bytes
    "block": [
        Frame(0x601, bytes.fromhex("C214630102000000")),  # as a block; then its only segment
        Frame(0x601, bytes.fromhex("8100100000000000")),
    ],
}
HOLD_SETPOINT = Frame(0x601, bytes.fromhex("4014630100000000"))


@pytest.mark.parametrize("transfer", TRANSFERS.values(), ids=TRANSFERS)
def test_a_controller_that_dies_in_a_transfer_leaves_nothing_behind(transfer):
    died = 200 * MS
    heartbeat = Frame(0x700 + CONTROLLER, b"\x05")
    watch = download_request(VALVE, 0x1016, 1, struct.pack("<I", CONTROLLER << 16 | TIMEOUT // MS))
    arrivals = [
        *at(2 * MS, watch, START_ALL),
        *every(10 * MS, 5 * MS, died, heartbeat, valve_command(7, HALF_OPEN)),
        *at(died, *transfer),
        *at(3 * SECOND, HOLD_SETPOINT),  # the next controller
    ]
    session = Session(arrivals, until=3 * SECOND + 10 * MS)

    ((time, code),) = session.emergencies()
    assert code == HEARTBEAT_LOST
    assert died <= time <= died + TIMEOUT
    assert session.is_centred(time + SETTLED, 3 * SECOND)
    answers = [frame.data for time, frame in session.sent if frame.can_id == VALVE_ANSWER]
    assert answers[-2] == bytes.fromhex("8014630100000405")  # abort: 0504 0000, timed out
    assert answers[-1] == bytes.fromhex("4B14630100000000")  # 0, as before


class SuspendingClock(VirtualClock):
    """Jumps by a minute and 300 us once, in the first wait that ends after a second."""

    def __init__(self):
        super().__init__()
        self.is_over = False

    def sleep_until(self, deadline):
        super().sleep_until(deadline)
        if not self.is_over and deadline >= SECOND:
            self.is_over = True
            self.advance(MINUTE + 300_000)


def test_a_suspended_bench_keeps_its_phase_and_takes_what_has_waited():
    requests = every(SECOND, SECOND + MS, SECOND + MINUTE, READ_DEVICE_TYPE)
    arrivals = [
        *at(2 * MS, *SET_UP),
        *every(10 * MS, 5 * MS, SECOND, valve_command(7, HALF_OPEN)),
        *requests,
    ]
    session = Session(arrivals, until=SECOND + MINUTE + 100 * MS, clock=SuspendingClock())

    ticks = session.report.ticks
    assert ticks.skipped == MINUTE // MS
    assert ticks.lateness.max_us == pytest.approx(MINUTE / 1000, rel=0.01)  # told in the summary
    assert {time % MS for time in session.spools} == {0}  # the phase
    assert len(session.spools) == 1000 + 100
    # The first tick of after finds a controller that is silent for a minute.
    ((time, code),) = session.emergencies()
    assert (time // MS, code) == ((SECOND + MINUTE) // MS, RPDO_TIMED_OUT)
    assert session.is_centred(time + SETTLED, time + 100 * MS)
    assert session.waiting == []
    assert len(session.times_of(VALVE_ANSWER)) == 2 + 60  # two of SET_UP are the valve's


def test_a_suspension_brings_no_burst_of_what_was_missed():
    heartbeats = [download_request(node_id, 0x1017, 0, b"\x0a\x00") for node_id in NODES]  # 10 ms
    session = Session(
        at(2 * MS, *heartbeats), until=SECOND + MINUTE + 100 * MS, clock=SuspendingClock()
    )
    after = [time for time in session.times_of(0x701) if time >= SECOND + MINUTE]
    assert len(after) == pytest.approx(10, abs=1)


@settings(max_examples=30)
@given(st.lists(ANY_FRAME, max_size=60))
def test_no_garbage_stops_the_bench_or_opens_the_valve_further_than_it_goes(garbage):
    bus = BusSide()
    bus.activate()
    for number in range(0, len(garbage), 4):
        bus.tick(*garbage[number : number + 4])
        assert abs(bus.plant.output.nu) < 1.1 * FULL_OPENING
    bus.nmt(0x81)  # reset all nodes
    bus.tick()
    answers = bus.tick(READ_DEVICE_TYPE)
    # Unless LSS took its node-ID away, the valve is as new.
    assert DEVICE_TYPE_408 in answers or any(frame.can_id == 0x7E5 for frame in garbage)
