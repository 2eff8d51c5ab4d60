"""The paced run on a transport, with a clock that jumps."""

from hil_bench import BusError, RecordingWish, load_config, read_frames
from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.abilities.recording.sessions import recorded
from hil_bench.bench.paced import (
    FRAMES_PER_MILLISECOND,
    ROUNDS_BETWEEN_TICKS,
    frames_per_tick,
    run_paced,
)
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import TransportCounters

TICK = 1_000_000


class ScriptedTransport:
    """Gives the bench its frames and keeps what it sends."""

    description = "scripted"
    has_exact_wait = False

    def __init__(self, arriving=(), lost_after=None):
        self.arriving = list(arriving)
        self.lost_after = lost_after
        self.sent = []
        self.filters = []
        self.batches = []
        self.heard_at_answer = 0

    def receive(self, limit):
        if self.lost_after is not None and len(self.batches) >= self.lost_after:
            raise BusError("scripted: the bus is lost")
        batch, self.arriving = self.arriving[:limit], self.arriving[limit:]
        self.batches.append(len(batch))
        return batch

    def send(self, frames):
        self.sent += frames
        if any(frame.can_id == 0x581 for frame in frames):
            self.heard_at_answer = len(self.filters)

    def listen_to(self, can_ids):
        self.filters.append(frozenset(can_ids))

    def counters(self):
        return TransportCounters(received=sum(self.batches), sent=len(self.sent))


def run(transport, ticks, observe=None, tables=None):
    session = open_session(load_config(tables=tables))
    session.watch(ticks=observe)
    clock = VirtualClock()
    clock.advance(4711 * TICK)  # a machine's clock does not begin with 0
    pacer = Pacer(clock, TICK)
    return run_paced(session, transport, pacer, stopped=lambda: pacer.statistics.ticks == ticks)


def test_it_runs_until_it_is_stopped():
    transport = ScriptedTransport()
    report = run(transport, ticks=25)
    assert report.ticks.ticks == 25
    assert report.lost is None
    assert [frame.can_id for frame in transport.sent] == [0x701, 0x702, 0x703, 0x704]
    assert report.frames == TransportCounters(received=0, sent=4)


def test_bench_time_begins_with_the_first_tick():
    times = []
    run(ScriptedTransport(), ticks=4, observe=times.append)
    assert times == [0, TICK, 2 * TICK, 3 * TICK]


def test_the_bus_does_not_wait_for_observers():
    transport = ScriptedTransport()
    sent = []
    run(transport, ticks=1, observe=lambda _now: sent.append(len(transport.sent)))
    assert sent == [4]  # the boot-up messages


def test_on_a_bus_like_copper_a_frame_is_handed_on_by_the_first_tick_after_it_has_passed():
    transport, handed_on = ScriptedTransport(), []

    def observe(now):
        handed_on.extend([now] * (len(transport.sent) - len(handed_on)))

    # At 10 kbit/s a bit takes 100 us, and a boot-up message some 6 ticks.
    run(transport, 40, observe, {"bus": {"bitrate": 10_000, "wire": {}}})
    assert [frame.can_id for frame in transport.sent] == [0x701, 0x702, 0x703, 0x704]
    passed, expected = 0, []
    for frame in transport.sent:  # one after the other, from the first tick on
        passed += 100_000 * exact_bits(frame)
        expected.append(-(-passed // TICK) * TICK)
    assert handed_on == expected


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
    session = open_session(load_config())
    report = run_paced(session, transport, pacer, stopped=lambda: pacer.statistics.ticks == 40)
    # Lateness at the start of each tick, by hand: 0, 2.2, 1.6, 1.0 (as long as the period, so a
    # full share again), 3.2, 2.6, 2.0, 1.4, 0.8 ms. A full share when late would have cost ticks.
    assert transport.batches[:10] == [32, 4, 4, 32, 4, 4, 4, 4, 12, 0]
    assert report.ticks.skipped == 0


def test_the_share_of_a_tick_follows_its_period():
    # Twice the 16 frames that a 1 Mbit/s bus can carry in 1 ms; at least 4; 256 fit the SDO queue.
    expected = {100: 4, 1000: 32, 5000: 160, 10_000: 256, 1_000_000: 256}
    assert {period_us: frames_per_tick(period_us * 1000) for period_us in expected} == expected


def test_the_bus_is_asked_for_new_identifiers_when_they_change():
    watch_node_5 = Frame(0x601, bytes.fromhex("2316100132000500"))  # 0x1016.01 = 5, 50 ms
    transport = ScriptedTransport([Frame(0x7FF)] * FRAMES_PER_MILLISECOND + [watch_node_5])
    run(transport, ticks=5)
    assert len(transport.filters) == 2
    assert transport.filters[1] - transport.filters[0] == {0x705}
    # Who has the answer may use the new identifier: it is listened to by then.
    assert transport.heard_at_answer == 2
    assert {0x000, 0x080, 0x201, 0x601, 0x602, 0x603, 0x604} <= transport.filters[0]


def test_a_lost_bus_ends_the_run_and_is_reported():
    report = run(ScriptedTransport(lost_after=3), ticks=10)
    assert str(report.lost) == "scripted: the bus is lost"
    assert report.ticks.ticks == 3


def test_an_interface_that_is_down_at_the_end_is_a_lost_bus():
    transport = ScriptedTransport()
    transport.counters = lambda: TransportCounters(outages=1, is_down=True)
    report = run(transport, ticks=3)
    assert report.ticks.ticks == 3
    assert str(report.lost) == "scripted: the interface was down at the end"


class TimedTransport(ScriptedTransport):
    """Brings each frame at its time; a wait lets time pass, and sending takes 20 us."""

    has_exact_wait = True

    def __init__(self, clock, arrivals):
        super().__init__()
        self.clock = clock
        self.arrivals = list(arrivals)
        self.sent_at = []
        self.limits = []

    def wait(self, timeout):
        deadline = self.clock.now() + round(timeout * 1e9)
        due = self.arrivals[0][0] if self.arrivals else deadline
        self.clock.sleep_until(min(due, deadline))
        return due <= deadline

    def receive(self, limit):
        self.limits.append(limit)
        frames = []
        while self.arrivals and self.arrivals[0][0] <= self.clock.now() and len(frames) < limit:
            frames.append(self.arrivals.pop(0)[1])
        return frames

    def send(self, frames):
        self.clock.advance(20_000 * len(frames))
        self.sent_at += [(self.clock.now(), frame.can_id) for frame in frames]


def us(time):
    return round(time * 1_000)


READ_VALVE = Frame(0x601, b"\x40\x00\x10\x00\x00\x00\x00\x00")
READ_POSITION = Frame(0x604, READ_VALVE.data)
SYNC = Frame(0x080)


def run_ticks(arrivals, ticks, **options):
    """Run on a clock that starts at 0; return transport and pacer."""
    clock = VirtualClock()
    transport = TimedTransport(clock, arrivals)
    pacer = Pacer(clock, TICK)
    run_paced(
        open_session(load_config()),
        transport,
        pacer,
        stopped=lambda: pacer.statistics.ticks == ticks,
        **options,
    )
    return transport, pacer


def answers(arrivals, ticks=5, **options):
    """Return the SDO answers of a run with their times [ns]."""
    transport, pacer = run_ticks(arrivals, ticks, **options)
    assert pacer.statistics.overruns == 0
    assert pacer.statistics.lateness.maximum == 0  # what fits in is all that is served
    return [(time, can_id) for time, can_id in transport.sent_at if can_id & 0x780 == 0x580]


def test_an_sdo_request_is_answered_between_two_ticks():
    # 20 us are what sending takes here.
    assert answers([(us(2300), READ_VALVE), (us(2400), READ_POSITION)]) == [
        (us(2320), 0x581),
        (us(2420), 0x584),
    ]


def test_a_pacer_of_other_seconds_has_them_answered_by_the_next_tick():
    arrivals = [(us(2300), READ_VALVE)]
    assert answers(arrivals, serves_between_ticks=False) == [(us(3020), 0x581)]


def test_shortly_before_a_tick_nothing_is_served():
    assert answers([(us(2960), READ_VALVE)]) == [(us(3020), 0x581)]
    # 120 us are room for two; sending both takes 40, and 80 are room for one.
    assert answers([(us(2880), READ_VALVE)] * 4) == [
        (us(2920), 0x581),
        (us(2920), 0x581),
        (us(2940), 0x581),
        (us(2960), 0x581),
    ]
    assert answers([(us(2920), READ_VALVE)] * 4) == [
        (us(2940), 0x581),
        (us(2960), 0x581),
        *[(us(3040), 0x581)] * 2,  # 40 us are no room, so these wait for the tick
    ]


def test_nothing_overtakes_what_is_for_the_tick():
    assert answers([(us(2300), SYNC), (us(2310), READ_VALVE)]) == [(us(3020), 0x581)]
    assert answers([(us(2300), READ_VALVE), (us(2300), SYNC), (us(2300), READ_POSITION)]) == [
        (us(2320), 0x581),
        (us(3020), 0x584),
    ]


def test_a_frame_for_nobody_holds_nothing_back():
    assert answers([(us(2300), Frame(0x7FF)), (us(2310), READ_VALVE)]) == [(us(2330), 0x581)]


def test_a_flood_between_ticks_costs_none():
    flood = [(us(2000) + 10_000 * n, Frame(0x7FF)) for n in range(400)]
    assert answers([*flood, (us(8300), READ_VALVE)], ticks=11) == [(us(8320), 0x581)]
    requests = [(us(2000), READ_VALVE)] * 300
    assert len(answers(requests, ticks=30)) == 300


def test_between_two_ticks_the_bus_is_looked_at_some_times_only():
    flood = [(us(10) + 10_000 * n, Frame(0x7FF)) for n in range(90)]  # one each 10 us
    assert len(run_ticks(flood, 1)[0].limits) == 1 + ROUNDS_BETWEEN_TICKS


def test_what_was_held_back_counts_among_the_frames_of_a_tick():
    arrivals = [(us(300), SYNC)] * 10
    # The first tick; four of the ten between the ticks, which are held back; the second tick.
    assert run_ticks(arrivals, 2)[0].limits[:3] == [32, 4, 32 - 4]


def test_an_object_written_between_ticks_acts_in_the_next_one():
    """0x1400.01: RPDO1 is told another identifier, and the bus is asked for it at once."""
    clock = VirtualClock()
    writes = ["23001401010200c0", "2300140102020000"]  # off first, as CiA 301 wants it
    transport = TimedTransport(
        clock,
        [(us(2300 + 100 * n), Frame(0x601, bytes.fromhex(data))) for n, data in enumerate(writes)],
    )
    pacer = Pacer(clock, TICK)
    run_paced(
        open_session(load_config()), transport, pacer, stopped=lambda: pacer.statistics.ticks == 3
    )
    assert 0x201 in transport.filters[0]
    assert 0x201 not in transport.filters[-1]


def recorded_run(path, arrivals, ticks, **options):
    """Run with a recording on a clock that starts at 0; return the transport and the frames."""
    clock = VirtualClock()
    transport = TimedTransport(clock, arrivals)
    pacer = Pacer(clock, TICK)
    config = load_config()
    session = open_session(config)
    with recorded(session, RecordingWish((path,)), config, is_real_time=False):
        run_paced(
            *(session, transport, pacer), stopped=lambda: pacer.statistics.ticks == ticks, **options
        )
    return transport, list(read_frames(path))


def test_a_recording_dates_frames_by_the_tick_that_took_them_or_after_which_they_were_served(
    tmp_path,
):
    arrivals = [(us(2300), READ_VALVE), (us(2400), SYNC), (us(2500), READ_POSITION)]
    _, frames = recorded_run(tmp_path / "run.mf4", arrivals, 5)
    seen = [(logged.now, logged.frame.can_id, logged.is_received) for logged in frames]
    assert seen[:4] == [(0, 0x700 + node, False) for node in (1, 2, 3, 4)]
    assert seen[4:] == [
        (2 * TICK, 0x601, True),  # served after tick 2, at which the bench stands still
        (2 * TICK, 0x581, False),
        (3 * TICK, 0x080, True),  # held back for tick 3, with all behind it
        (3 * TICK, 0x604, True),
        (3 * TICK, 0x584, False),
    ]


def test_a_recording_changes_no_filter(tmp_path):
    transport, _ = recorded_run(tmp_path / "run.mf4", [], 3)
    assert transport.filters == run_ticks([], 3)[0].filters
    assert len(transport.filters) == 1


def test_who_wants_to_hear_the_whole_bus_sets_no_filter(tmp_path):
    arrivals = [(us(1500), Frame(0x7FF))]
    transport, frames = recorded_run(tmp_path / "run.mf4", arrivals, 3, hears_all=True)
    assert transport.filters == []
    assert [logged.frame.can_id for logged in frames if logged.is_received] == [0x7FF]
