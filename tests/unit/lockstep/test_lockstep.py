"""Lock-step: SYNC is what time is made of, and the trace depends on the frames received alone."""

import hashlib
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from hil_bench import BusError, load_config
from hil_bench.abilities.lockstep.lockstep import LockStep, run_lockstep
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import FDF, Frame
from hil_bench.outside.transports.transport import TransportCounters

TICK = 1_000_000  # [ns]
SYNC = Frame(0x080)
READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")
START_ALL = Frame(0x000, b"\x01\x00")
SYNCHRONOUS_TPDOS = [  # 0x1800.02 = 1: with every SYNC
    Frame(0x600 + node_id, bytes.fromhex("2f00180201000000")) for node_id in (1, 2, 3, 4)
]


def command(setpoint):
    """The valve's RPDO 1: enabled, set-point in 1/16384 of full opening."""
    return Frame(0x201, struct.pack("<Hh", 7, setpoint))


def make_lockstep(ticks_per_sync=1):
    bench = build_bench(load_config())
    bench.start(0)
    bench.tick([], 0)
    lockstep = LockStep(Session(bench), tick_ns=TICK, ticks_per_sync=ticks_per_sync)
    return bench, lockstep


def test_each_sync_advances_the_bench_by_one_period_and_nothing_else_does():
    _, lockstep = make_lockstep(ticks_per_sync=5)
    for frame in (*SYNCHRONOUS_TPDOS, START_ALL, command(0), SYNC, SYNC):
        lockstep.receive(frame)
    assert (lockstep.now, lockstep.syncs) == (10 * TICK, 2)


def test_a_frame_with_the_number_of_sync_that_is_none_is_no_sync():
    _, lockstep = make_lockstep()
    lockstep.receive(Frame(0x080, is_remote=True))
    lockstep.receive(Frame(0x080, is_extended=True))
    lockstep.receive(Frame(0x080, fd=FDF))
    assert (lockstep.now, lockstep.syncs) == (0, 0)


def test_sdo_and_nmt_are_answered_while_plant_and_time_stand_still():
    bench, lockstep = make_lockstep()
    state = bench.axes[0].plant.state
    answers = [lockstep.receive(Frame(0x601, READ_DEVICE_TYPE)) for _ in range(3)]
    assert [frame.can_id for sent in answers for frame in sent] == [0x581] * 3
    assert lockstep.receive(Frame(0x000, b"\x81\x01")) == [Frame(0x701, b"\x00")]  # reset: boot-up
    assert (lockstep.now, bench.axes[0].plant.state) == (0, state)


def test_a_sync_is_answered_by_every_synchronous_tpdo_of_its_first_tick():
    bench, lockstep = make_lockstep(ticks_per_sync=3)
    for frame in (*SYNCHRONOUS_TPDOS, START_ALL, SYNC, command(16384)):
        lockstep.receive(frame)
    sent = {frame.can_id: frame.data for frame in lockstep.receive(SYNC)}
    assert {0x181, 0x182, 0x183, 0x184} <= sent.keys()
    # The spool after the first millisecond of the set-point, by hand in tests/bench/test_tick.py.
    spool = struct.unpack_from("<h", sent[0x181], 2)[0] / 16384 * 1.3e-3
    assert spool == pytest.approx(0.5167e-3, rel=1e-3)
    assert bench.axes[0].plant.output.nu > 1e-3  # two more ticks have moved it on since


def test_it_is_the_run_in_real_time_of_a_controller_that_is_never_late():
    paced = build_bench(load_config())
    paced.start(0)
    expected = [paced.tick([], 0)]
    _, lockstep = make_lockstep(ticks_per_sync=2)
    for sync in range(100):
        setpoint = command(8192 if sync % 50 < 25 else -8192)
        lockstep.receive(setpoint)
        expected = paced.tick([setpoint, SYNC], (2 * sync + 1) * TICK)
        expected += paced.tick([], (2 * sync + 2) * TICK)
        assert lockstep.receive(SYNC) == expected


class BundlingTransport:
    """Gives the bench its frames in bundles of a given length, and then is gone."""

    description = "bundling"

    def __init__(self, frames, bundle):
        self.arriving = list(frames)
        self.bundle = bundle
        self.sent = []

    def wait(self, timeout):
        assert timeout > 0
        if not self.arriving:
            raise BusError("bundling: all is said")
        return True

    def receive(self, limit):
        count = min(limit, self.bundle)
        taken, self.arriving = self.arriving[:count], self.arriving[count:]
        return taken

    def send(self, frames):
        self.sent += frames

    def counters(self):
        return TransportCounters(sent=len(self.sent))


def session(length):
    yield from (*SYNCHRONOUS_TPDOS, START_ALL)
    for number in range(length):
        yield command(12000 if number // 40 % 2 else -12000)
        yield Frame(0x604, READ_DEVICE_TYPE)
        yield SYNC


def sent_in_bundles(bundle, length=100):
    _, lockstep = make_lockstep()
    transport = BundlingTransport(session(length), bundle)
    report = run_lockstep(lockstep, transport, stopped=lambda: False)
    assert str(report.lost) == "bundling: all is said"
    assert (report.now, report.syncs) == (length * TICK, length)
    return transport.sent


def test_how_the_bus_bundles_frames_changes_nothing():
    one_by_one = sent_in_bundles(1)
    assert len(one_by_one) > 5 * 100
    assert sent_in_bundles(7) == one_by_one
    assert sent_in_bundles(1000) == one_by_one


def test_it_stops_between_two_frames():
    _, lockstep = make_lockstep()
    transport = BundlingTransport([SYNC] * 10, 10)
    report = run_lockstep(lockstep, transport, stopped=lambda: lockstep.syncs == 4)
    assert (report.syncs, report.lost) == (4, None)


def test_silence_lets_no_time_pass():
    class Silence(BundlingTransport):
        waits = 0

        def wait(self, _timeout):
            self.waits += 1
            return False

    _, lockstep = make_lockstep()
    silence = Silence([], 1)
    report = run_lockstep(lockstep, silence, stopped=lambda: silence.waits == 50)
    assert (report.now, report.syncs, silence.sent) == (0, 0, [])


def digest(frames):
    text = "\n".join(f"{frame.can_id:03X}#{frame.data.hex()}" for frame in frames)
    return hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("hash_seed", ["0", pytest.param("4711", marks=pytest.mark.long)])
def test_the_trace_is_the_same_for_every_hash_seed(hash_seed):
    script = "from test_lockstep import *; print(digest(sent_in_bundles(1, 30)))"
    done = subprocess.run(  # noqa: S603 - a script of our own
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONHASHSEED": hash_seed, "PYTHONPATH": ":".join(search_path())},
    )
    assert done.stdout.strip() == digest(sent_in_bundles(1, 30))


def search_path():
    return [str(Path(__file__).parent), *filter(None, sys.path)]


def test_a_frame_is_served_by_whom_it_concerns_and_the_others_stay_as_they_are():
    bench, lockstep = make_lockstep()
    twin = build_bench(load_config())
    twin.start(0)
    twin.tick([], 0)
    for frame in (*SYNCHRONOUS_TPDOS, START_ALL, Frame(0x000, b"\x80\x02"), command(100)):
        # Two frames at once look at every node.
        assert lockstep.receive(frame) == twin.serve([frame, Frame(0x7FF)], 0)
    assert lockstep.receive(SYNC) == twin.tick([SYNC], TICK)
    assert [node.state for node in bench.nodes] == [node.state for node in twin.nodes]


def test_what_the_bus_did_not_take_is_sent_again_while_nothing_comes():
    class FullQueue(BundlingTransport):
        """Takes nothing at the first time, and what waits with the next call."""

        waiting = ()

        def wait(self, _timeout):
            return bool(self.arriving)

        def send(self, frames):
            self.sent += self.waiting if not frames else ()
            self.waiting = (*self.waiting, *frames) if frames else ()

    _, lockstep = make_lockstep()
    transport = FullQueue([Frame(0x601, READ_DEVICE_TYPE)], 1)
    run_lockstep(lockstep, transport, stopped=lambda: bool(transport.sent))
    assert [frame.can_id for frame in transport.sent] == [0x581]
