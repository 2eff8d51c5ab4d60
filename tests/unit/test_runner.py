"""The paced run on a transport, with a clock that jumps."""

import pytest

from hil_bench.assembly import build_bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import load_config
from hil_bench.errors import BusError
from hil_bench.realtime.clock import VirtualClock
from hil_bench.realtime.pacer import Pacer
from hil_bench.runner import FRAMES_PER_MILLISECOND, frames_per_tick, run_paced
from hil_bench.transports.transport import TransportCounters

TICK = 1_000_000


class ScriptedTransport:
    """Gives the bench its frames and keeps what it sends."""

    description = "scripted"

    def __init__(self, arriving=(), lost_after=None):
        self.arriving = list(arriving)
        self.lost_after = lost_after
        self.sent = []
        self.filters = []
        self.batches = []

    def receive(self, limit):
        if self.lost_after is not None and len(self.batches) >= self.lost_after:
            raise BusError("scripted: the bus is lost")
        batch, self.arriving = self.arriving[:limit], self.arriving[limit:]
        self.batches.append(len(batch))
        return batch

    def send(self, frames):
        self.sent += frames

    def listen_to(self, can_ids):
        self.filters.append(frozenset(can_ids))

    def counters(self):
        return TransportCounters(received=sum(self.batches), sent=len(self.sent))


def run(transport, ticks, observers=()):
    bench = build_bench(load_config())
    pacer = Pacer(VirtualClock(), TICK)
    return run_paced(
        bench,
        transport,
        pacer,
        stopped=lambda: pacer.statistics.ticks == ticks,
        observers=observers,
    )


def test_it_runs_until_it_is_stopped():
    transport = ScriptedTransport()
    report = run(transport, ticks=25)
    assert report.ticks.ticks == 25
    assert report.lost is None
    assert [frame.can_id for frame in transport.sent] == [0x701, 0x702, 0x703, 0x704]
    assert report.frames == TransportCounters(received=0, sent=4)


def test_observers_see_each_tick_at_its_scheduled_time():
    times = []
    run(ScriptedTransport(), ticks=4, observers=[lambda _bench, now: times.append(now)])
    assert times == [times[0] + k * TICK for k in range(4)]


def test_a_flood_is_taken_a_bounded_share_at_a_time_and_none_is_lost():
    requests = [Frame(0x601, b"\x40\x00\x10\x00\x00\x00\x00\x00")] * (
        3 * FRAMES_PER_MILLISECOND + 5
    )
    transport = ScriptedTransport(requests)
    run(transport, ticks=6)
    assert transport.batches == [FRAMES_PER_MILLISECOND] * 3 + [5, 0, 0]
    answers = [frame for frame in transport.sent if frame.can_id == 0x581]
    # The first share comes before the boot-up message has made the node PRE-OPERATIONAL.
    assert len(answers) == len(requests) - FRAMES_PER_MILLISECOND


def test_a_flood_that_makes_the_loop_late_is_taken_in_small_shares_and_costs_no_tick():
    # Each frame costs 0.1 ms of a tick of 1 ms, so a full share of 32 takes 3.2 ms.
    clock = VirtualClock()
    transport = ScriptedTransport([Frame(0x7FF)] * 100)
    pacer = Pacer(clock, TICK, backlog=4 * TICK)
    receive = transport.receive

    def receive_slowly(limit):
        batch = receive(limit)
        clock.advance(len(batch) * TICK // 10)
        return batch

    transport.receive = receive_slowly
    bench = build_bench(load_config())
    report = run_paced(bench, transport, pacer, stopped=lambda: pacer.statistics.ticks == 40)
    # Lateness at the start of each tick, by hand: 0, 2.2, 1.6, 1.0 (as long as the period, so a
    # full share again), 3.2, 2.6, 2.0, 1.4, 0.8 ms. A full share when late would have cost ticks.
    assert transport.batches[:10] == [32, 4, 4, 32, 4, 4, 4, 4, 12, 0]
    assert report.ticks.skipped == 0


@pytest.mark.parametrize(
    ("period_us", "frames"),
    # Twice the 16 frames that a 1 Mbit/s bus can carry in 1 ms; at least 4; 256 fit the SDO queue.
    [(100, 4), (1000, 32), (5000, 160), (10_000, 256), (1_000_000, 256)],
)
def test_the_share_of_a_tick_follows_its_period(period_us, frames):
    assert frames_per_tick(period_us * 1000) == frames


def test_the_bus_is_asked_for_new_identifiers_when_they_change():
    watch_node_5 = Frame(0x601, bytes.fromhex("2316100132000500"))  # 0x1016.01 = 5, 50 ms
    transport = ScriptedTransport([Frame(0x7FF)] * FRAMES_PER_MILLISECOND + [watch_node_5])
    run(transport, ticks=5)
    assert len(transport.filters) == 2
    assert transport.filters[1] - transport.filters[0] == {0x705}
    assert {0x000, 0x080, 0x201, 0x601, 0x602, 0x603, 0x604} <= transport.filters[0]


def test_a_lost_bus_ends_the_run_and_is_reported():
    report = run(ScriptedTransport(lost_after=3), ticks=10)
    assert str(report.lost) == "scripted: the bus is lost"
    assert report.ticks.ticks == 3
