"""Where lock-step and real time begin, wait and end, on fake clocks; no device takes part."""

import logging
from types import SimpleNamespace

import pytest

from hil_bench.abilities.lockstep.firmware import LockStepLink, RealTimeLink, advance
from hil_bench.abilities.lockstep.lockstep import (
    FRAMES_AT_ONCE,
    LockStep,
    LockStepBus,
    SyncWatch,
    run_lockstep,
)
from hil_bench.bench.paced import frames_per_tick
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError, ControllerError
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import TransportCounters

MILLISECOND, SECOND = 1_000_000, 1_000_000_000
SYNC, OTHER, ANSWER = Frame(0x080), Frame(0x601, bytes(8)), Frame(0x581, bytes(8))


class Bench:
    """A session that notes its rounds, and answers each with one frame."""

    def __init__(self):
        self.rounds = []
        self.now = 0
        self.bench = SimpleNamespace(medium=None)

    def tick(self, frames, now, send=None):
        self.now = now
        self.rounds.append(("tick", tuple(frames), now))
        sent = [Frame(0x181, bytes([len(self.rounds) % 256]))]
        if send is not None:
            send(sent)
        return sent

    def serve(self, frames):
        self.rounds.append(("serve", tuple(frames), self.now))
        return [ANSWER]


class Bus:
    """Brings the frames that it is given, and takes `takes` for a wait in vain."""

    description = "fake"

    def __init__(self, clock, takes=SECOND // 10):
        self.clock, self.takes = clock, takes
        self.arriving, self.sent, self.waits, self.limits = [], [], [], []
        self.is_down = False

    def wait(self, timeout):
        self.waits.append(timeout)
        if not self.arriving:
            self.clock.advance(self.takes)
        return bool(self.arriving)

    def receive(self, limit):
        self.limits.append(limit)
        taken, self.arriving = self.arriving[:limit], self.arriving[limit:]
        return taken

    def send(self, frames):
        self.sent.append(tuple(frames))

    def counters(self):
        return TransportCounters(is_down=self.is_down)


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def bus(clock):
    return Bus(clock)


@pytest.fixture
def bench():
    return Bench()


def lockstep_of(bench, now=0, ticks=1):
    bench.now = now
    return LockStep(bench, tick_ns=MILLISECOND, ticks_per_sync=ticks)


def test_the_first_tick_of_a_period_takes_the_sync_and_the_others_nothing(bench):
    lockstep = lockstep_of(bench, now=7 * MILLISECOND, ticks=3)
    sent = lockstep.receive(SYNC)
    assert bench.rounds == [
        ("tick", (SYNC,), 8 * MILLISECOND),
        ("tick", (), 9 * MILLISECOND),
        ("tick", (), 10 * MILLISECOND),
    ]
    assert [frame.data for frame in sent] == [b"\x01", b"\x02", b"\x03"]


@pytest.mark.parametrize(
    "frame",
    [
        *(OTHER, Frame(0x07F), Frame(0x081), Frame(0x080, is_remote=True)),
        *(Frame(0x080, is_extended=True), Frame(0x080, bus=1)),
    ],
)
def test_no_other_frame_lets_time_pass(bench, frame):
    lockstep = lockstep_of(bench, now=7 * MILLISECOND)
    assert lockstep.receive(frame) == [ANSWER]
    assert bench.rounds == [("serve", (frame,), 7 * MILLISECOND)]
    assert (lockstep.now, lockstep.syncs) == (7 * MILLISECOND, 0)


def test_one_look_takes_one_frame_and_asks_the_bus_only_when_none_is_left(bench, bus):
    stepped = LockStepBus(lockstep_of(bench), bus)
    bus.arriving = [OTHER] * (FRAMES_AT_ONCE + 1)
    for count in range(1, FRAMES_AT_ONCE + 2):
        assert stepped.step()
        assert len(bench.rounds) == count
    assert bus.limits == [FRAMES_AT_ONCE] * 2
    assert bus.waits == [0.1] * 2
    assert bus.sent == [(ANSWER,)] * (FRAMES_AT_ONCE + 1)
    assert not stepped.step(0.0)
    assert bus.waits[-1] == 0.0
    assert bus.sent[-1] == ()  # what the bus did not take before gets another chance


def test_a_bus_that_woke_for_nothing_is_no_silence(bench, bus):
    stepped = LockStepBus(lockstep_of(bench), bus)
    bus.wait = lambda _timeout: True  # an error frame, which `receive` leaves out
    assert stepped.step()
    assert bench.rounds == []


def test_that_sync_stays_away_is_said_once_after_5_s_and_so_is_its_return(bench, clock, caplog):
    lockstep = lockstep_of(bench)
    watch = SyncWatch(lockstep, "fake", clock)

    def look_after(nanoseconds):
        clock.advance(nanoseconds)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            watch.look()
        return [record.getMessage() for record in caplog.records]

    assert look_after(5 * SECOND - 1) == []
    (told,) = look_after(1)
    assert told == (
        "fake: no SYNC (0x080) for 5 s; bench time stands still at 0.000 s, and so do time-outs "
        "and valve"
    )
    assert look_after(60 * SECOND) == []
    lockstep.receive(SYNC)
    assert look_after(2 * SECOND) == ["fake: SYNC has come after 67.0 s; bench time goes on"]
    assert look_after(5 * SECOND - 1) == []
    lockstep.receive(SYNC)
    assert look_after(2 * SECOND) == []  # nothing was missed
    assert look_after(5 * SECOND - 1) == []
    assert look_after(1)[0].startswith("fake: no SYNC (0x080) for 5 s; bench time stands still at")


def test_the_time_of_a_run_goes_from_its_first_sync_to_its_last(bench, clock):
    lockstep = lockstep_of(bench)
    clock.advance(3 * SECOND)
    watch = SyncWatch(lockstep, "fake", clock)
    watch.look()
    assert watch.moved == 0.0
    for _ in range(3):
        clock.advance(2 * SECOND)
        lockstep.receive(SYNC)
        watch.look()
    clock.advance(9 * SECOND)
    watch.look()
    assert watch.moved == pytest.approx(4.0)


def test_a_run_watches_sync_and_reports(bench, bus, caplog):
    lockstep = lockstep_of(bench)
    with caplog.at_level(logging.WARNING):
        report = run_lockstep(
            lockstep, bus, stopped=lambda: bus.clock.now() >= 6 * SECOND, clock=bus.clock
        )
    assert "fake: no SYNC (0x080) for 5 s" in caplog.text
    assert (report.now, report.syncs, report.moved, report.lost) == (0, 0, 0.0, None)


def test_a_run_ends_with_the_bus_and_says_why(bench, bus):
    lost = BusError("the cable is out")

    def wait(_timeout):
        raise lost

    bus.wait = wait
    bus.is_down = True
    assert run_lockstep(lockstep_of(bench), bus, stopped=lambda: False).lost is lost


def test_an_interface_that_is_down_at_the_end_is_told(bench, bus):
    bus.is_down = True
    report = run_lockstep(lockstep_of(bench), bus, stopped=lambda: True)
    assert str(report.lost) == "fake: the interface was down at the end"


def steps(link, most=1000):
    """Return how many steps a link takes until it gives its controller up."""
    for count in range(most):
        try:
            link.step()
        except ControllerError:
            return count
    return most


@pytest.mark.parametrize(("frame", "patience"), [(None, 20.0), (OTHER, 20.0)])
def test_a_controller_is_given_up_after_its_time_and_not_at_it(bench, bus, frame, patience):
    clock, wait = bus.clock, bus.wait
    clock.advance(1000 * SECOND)  # what was before does not count

    def wait_for_frame(timeout):
        bus.arriving = [] if frame is None else [frame]
        if frame is not None:
            clock.advance(bus.takes)
        return wait(timeout)

    bus.wait = wait_for_frame
    bus.takes = SECOND // 16  # which a float holds exactly
    # After `patience` it is still waited for: the first step beyond it ends the wait.
    assert steps(LockStepLink(lockstep_of(bench), bus, clock=clock)) == patience * 16


@pytest.mark.parametrize(("sign", "left"), [(OTHER, 20 * 16 - 100), (SYNC, 20 * 16)])
def test_nothing_but_a_sync_starts_the_wait_anew(bench, bus, sign, left):
    bus.takes = SECOND // 16
    link = LockStepLink(lockstep_of(bench), bus, clock=bus.clock)
    for _ in range(100):
        link.step()
    bus.arriving = [sign]
    assert link.step()
    assert steps(link) == left


def test_a_sync_starts_the_wait_for_the_next_one_anew(bench, bus):
    clock, wait = bus.clock, bus.wait

    def wait_for_frame(timeout):
        clock.advance(SECOND // 16)
        bus.arriving = bus.arriving or [OTHER]
        return wait(timeout)

    bus.wait = wait_for_frame
    link = LockStepLink(lockstep_of(bench), bus, clock=clock)
    for _ in range(300):
        link.step()
    bus.arriving = [SYNC]
    link.step()
    assert steps(link) == 20 * 16


def test_draining_takes_what_is_there_and_waits_for_nothing(bench, bus):
    link = LockStepLink(lockstep_of(bench), bus, clock=bus.clock)
    bus.arriving = [OTHER, SYNC, OTHER]
    link.drain()
    assert [kind for kind, *_ in bench.rounds] == ["serve", "tick", "serve"]
    assert set(bus.waits) == {0.0}
    assert link.now == MILLISECOND


def test_a_step_says_whether_a_frame_came(bench, bus):
    link = LockStepLink(lockstep_of(bench), bus, clock=bus.clock)
    assert link.step() is False
    bus.arriving = [OTHER]
    assert link.step() is True


def test_in_real_time_the_first_tick_follows_the_last_one_and_the_clock_its_grid(bench, bus):
    bus.clock.advance(1234)
    pacer = Pacer(bus.clock, 2 * MILLISECOND)
    bench.now = 50 * MILLISECOND
    link = RealTimeLink(bench, bus, pacer)
    bus.arriving = [OTHER]
    assert link.step() is True
    assert link.step() is False
    link.drain()
    assert bench.rounds == [
        ("tick", (OTHER,), 52 * MILLISECOND),
        ("tick", (), 54 * MILLISECOND),
        ("tick", (), 56 * MILLISECOND),
    ]
    assert link.now == 56 * MILLISECOND
    assert bus.clock.now() == 1234 + 4 * MILLISECOND
    assert bus.limits == [frames_per_tick(2 * MILLISECOND)] * 3
    assert [frames[0].data for frames in bus.sent] == [b"\x01", b"\x02", b"\x03"]
    assert pacer.statistics.ticks == 3


class Link:
    """Lets a millisecond pass with each step, in which a frame comes or none."""

    def __init__(self, has_come):
        self.now, self.has_come, self.steps = 100, has_come, 0

    def step(self):
        self.steps += 1
        self.now += MILLISECOND
        return self.has_come


@pytest.mark.parametrize(
    ("duration", "count"),
    [(0, 0), (1, 1), (MILLISECOND, 1), (MILLISECOND + 1, 2), (3 * MILLISECOND, 3)],
)
@pytest.mark.parametrize("has_come", [True, False])
def test_advancing_ends_with_the_first_step_that_reaches_its_time(duration, count, has_come):
    link, checks = Link(has_come), []
    advance(link, duration, lambda: checks.append(link.now))
    assert link.steps == count
    assert len(checks) == (0 if has_come else count)
