import can
import pytest

from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.outside.transports.embedded import LONGEST_WAIT, EmbeddedBus

MS = 1_000_000


class ScriptedBench:
    """Sends what `script` holds for a tick's time [ns], and notes what it was given."""

    def __init__(self, script=None):
        self.script = script or {}
        self.ticks = []

    def __call__(self, frames, now):
        self.ticks.append((now, list(frames)))
        return self.script.get(now, [])


def message(can_id, data=b"", **flags):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **flags)


@pytest.fixture
def make_bus():
    buses = []

    def make(tick, **options):
        buses.append(EmbeddedBus(tick, MS, **options))
        return buses[-1]

    yield make
    for bus in buses:
        bus.shutdown()


def test_a_sent_frame_reaches_the_next_tick_and_its_answer_the_reader(make_bus):
    def echo(frames, _now):
        return [Frame(frame.can_id + 1, frame.data[::-1]) for frame in frames]

    bus = make_bus(echo)
    bus.send(message(0x201, b"\x01\x02"))
    answer = bus.recv(0.010)
    assert (answer.arbitration_id, bytes(answer.data)) == (0x202, b"\x02\x01")
    assert not answer.is_extended_id
    assert (answer.timestamp, bus.now()) == (0.001, 0.001)


def test_a_zero_timeout_runs_no_tick(make_bus):
    bench = ScriptedBench()
    bus = make_bus(bench)
    assert [bus.recv(0), bus.recv(-1.0), bus.recv(0.0)] == [None] * 3
    assert (bus.now(), bench.ticks) == (0, [])


def test_a_zero_timeout_takes_what_the_last_tick_left(make_bus):
    bus = make_bus(ScriptedBench({MS: [Frame(1), Frame(2), Frame(3)]}))
    assert bus.recv(0.001).arbitration_id == 1
    assert [bus.recv(0).arbitration_id for _ in range(2)] == [2, 3]
    assert bus.recv(0) is None
    assert bus.now() == 0.001


def test_ticks_stop_at_the_first_frame(make_bus):
    bench = ScriptedBench({3 * MS: [Frame(0x701, b"\x00")]})
    bus = make_bus(bench)
    assert bus.recv(1.0).timestamp == 0.003
    assert [now for now, _ in bench.ticks] == [MS, 2 * MS, 3 * MS]


def test_a_timeout_ends_at_its_own_time_and_the_grid_stays(make_bus):
    bench = ScriptedBench()
    bus = make_bus(bench)
    assert bus.recv(0.0025) is None
    assert bus.now() == 0.0025
    assert bus.recv(0.0005) is None
    assert bus.now() == 0.003
    assert [now for now, _ in bench.ticks] == [MS, 2 * MS, 3 * MS]


def test_waits_shorter_than_a_period_add_up(make_bus):
    bench = ScriptedBench()
    bus = make_bus(bench)
    for _ in range(4):
        assert bus.recv(0.00025) is None
    assert [now for now, _ in bench.ticks] == [MS]


def test_the_smallest_positive_wait_moves_the_time(make_bus):
    bus = make_bus(ScriptedBench())
    bus.recv(1e-13)
    assert bus.now() == 1e-9


def test_time_starts_where_it_is_told_to(make_bus):
    bench = ScriptedBench({7_000 + MS: [Frame(5)]})
    bus = make_bus(bench, start_ns=7_000)
    assert bus.now() == 7e-6
    assert bus.recv(0.001).arbitration_id == 5


def test_frames_reach_the_bench_in_the_order_sent_and_once(make_bus):
    bench = ScriptedBench()
    bus = make_bus(bench)
    bus.send(message(3, b"a"))
    bus.send(can.Message(arbitration_id=0x1234567, is_extended_id=True, is_remote_frame=True))
    bus.recv(0.002)
    first = [Frame(3, b"a"), Frame(0x1234567, b"", is_remote=True, is_extended=True)]
    assert bench.ticks == [(MS, first), (2 * MS, [])]


def test_the_bench_does_not_see_later_changes_of_a_message(make_bus):
    bench = ScriptedBench()
    bus = make_bus(bench)
    sent = message(3, bytearray(b"a"))
    bus.send(sent)
    sent.data[0] = 0
    bus.recv(0.001)
    assert bench.ticks[0][1] == [Frame(3, b"a")]


@pytest.mark.parametrize(
    "bad",
    [
        message(0x123, bytes(12), is_fd=True),
        message(0x123, is_error_frame=True),
        message(0x123, bytes(9)),
        message(0x800),
        can.Message(arbitration_id=1 << 29, is_extended_id=True),
    ],
    ids=["fd", "error frame", "nine bytes", "12-bit identifier", "30-bit identifier"],
)
def test_what_a_classical_bus_cannot_carry_is_refused(make_bus, bad):
    bench = ScriptedBench()
    bus = make_bus(bench)
    with pytest.raises(
        can.CanOperationError, match=r"no CAN data or remote|the bus is classical CAN; fd = true"
    ):
        bus.send(bad)
    bus.recv(0.001)
    assert bench.ticks == [(MS, [])]


def test_a_bus_of_can_fd_carries_both_kinds_both_ways(make_bus):
    long = Frame(0x123, bytes(range(64)), fd=FDF | BRS)
    bench = ScriptedBench({MS: [long, Frame(0x181, b"a")]})
    bus = make_bus(bench, fd=True)
    bus.send(message(0x124, bytes(12), is_fd=True, error_state_indicator=True))
    first, second = bus.recv(0.002), bus.recv(0.002)
    assert bench.ticks == [(MS, [Frame(0x124, bytes(12), fd=FDF | ESI)])]
    assert (first.is_fd, first.bitrate_switch, first.error_state_indicator) == (True, True, False)
    assert (bytes(first.data), first.dlc) == (bytes(range(64)), 64)
    assert (second.is_fd, second.arbitration_id) == (False, 0x181)
    with pytest.raises(can.CanOperationError, match="no CAN data"):
        bus.send(message(0x124, bytes(9), is_fd=True))


def test_filters_let_only_the_matching_frames_through(make_bus):
    script = {MS: [Frame(0x181), Frame(0x182)], 2 * MS: [Frame(0x701), Frame(0x182)]}
    bus = make_bus(
        ScriptedBench(script), can_filters=[{"can_id": 0x182, "can_mask": 0x7FF, "extended": False}]
    )
    received = [bus.recv(0.010), bus.recv(0.010)]
    assert [(m.arbitration_id, m.timestamp) for m in received] == [(0x182, 0.001), (0x182, 0.002)]


def test_a_filtered_frame_does_not_shorten_the_wait(make_bus):
    bus = make_bus(
        ScriptedBench({MS: [Frame(0x181)]}), can_filters=[{"can_id": 0x700, "can_mask": 0x7FF}]
    )
    assert bus.recv(0.005) is None
    assert bus.now() == 0.005


def test_the_hook_hears_all_frames_both_ways_in_order_of_time(make_bus):
    heard = []
    bus = make_bus(
        ScriptedBench({MS: [Frame(0x181)], 2 * MS: [Frame(0x182)]}),
        on_frame=lambda frame, now: heard.append((frame.can_id, now)),
        can_filters=[{"can_id": 0, "can_mask": 0x7FF}],
    )
    bus.send(message(0x201))
    bus.recv(0.0015)
    bus.send(message(0x202))
    bus.recv(0.0005)
    assert heard == [(0x201, 0), (0x181, MS), (0x202, 1_500_000), (0x182, 2 * MS)]


class NotingPacer:
    def __init__(self, log):
        self.log = log

    def wait(self):
        self.log.append("wait")
        return 0

    def done(self):
        self.log.append("done")


def test_the_pacer_holds_each_tick_back_and_hears_its_end(make_bus):
    log = []

    def tick(_frames, now):
        log.append(now)
        return []

    bus = make_bus(tick, pacer=NotingPacer(log))
    bus.recv(0.002)
    assert log == ["wait", MS, "done", "wait", 2 * MS, "done"]


def test_waiting_for_ever_on_a_silent_bench_ends_with_an_error():
    bench = ScriptedBench()
    with EmbeddedBus(bench, 10_000 * MS) as bus:
        with pytest.raises(can.CanTimeoutError, match="no frame in 60 s of bench time"):
            bus.recv()
        assert bus.now() == LONGEST_WAIT / 1e9
    assert len(bench.ticks) == 6  # 10 s each


def test_waiting_for_ever_returns_the_first_frame(make_bus):
    bus = make_bus(ScriptedBench({4 * MS: [Frame(9)]}))
    assert bus.recv().arbitration_id == 9


def test_an_error_of_the_bench_comes_out_of_the_wait(make_bus):
    def broken(_frames, _now):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        make_bus(broken).recv(0.001)


def test_a_bus_that_is_shut_down_refuses_work_and_may_be_shut_down_again(make_bus):
    bus = make_bus(ScriptedBench({MS: [Frame(1), Frame(2)]}))
    bus.recv(0.001)
    bus.shutdown()
    bus.shutdown()
    for use in (lambda: bus.recv(0), lambda: bus.send(message(1))):
        with pytest.raises(can.CanOperationError, match="shut down"):
            use()


def test_periodic_sending_from_a_thread_is_refused(make_bus):
    with pytest.raises(can.CanOperationError, match="send from the loop"):
        make_bus(ScriptedBench()).send_periodic(message(0x80), 0.01)


@pytest.mark.parametrize("period", [0, -1])
def test_a_period_that_is_not_positive_is_refused(period):
    with pytest.raises(ValueError, match="a positive number is right"):
        EmbeddedBus(ScriptedBench(), period)


def test_iterating_over_the_bus_yields_its_messages(make_bus):
    bus = make_bus(ScriptedBench({MS: [Frame(1)], 5 * MS: [Frame(2)]}))
    iterator = iter(bus)
    assert [next(iterator).arbitration_id, next(iterator).arbitration_id] == [1, 2]
