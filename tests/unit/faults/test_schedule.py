"""When faults begin and end."""

import pytest

from hil_bench.abilities.faults.fault import FaultSchedule
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.errors import ConfigError

MS = 1_000_000


class Note:
    """An effect that writes down when it began and ended."""

    def __init__(self):
        self.times = []

    def begin(self, now):
        self.times.append(("begin", now // MS))

    def end(self, now):
        self.times.append(("end", now // MS))


@pytest.fixture
def schedule():
    return FaultSchedule()


def add(schedule, **when):
    note = Note()
    return note, schedule.add("freeze", "sensor", note, **when)


def run(schedule, *ticks):
    """Advance at these ticks [ms], as a bench does: only when something is due."""
    for tick in ticks:
        if tick * MS >= schedule.due:
            schedule.advance(tick * MS)


def test_without_faults_nothing_is_due(schedule):
    assert schedule.due == NEVER


def test_a_fault_begins_with_the_next_tick_and_stays(schedule):
    note, fault = add(schedule)
    assert not fault.is_active
    run(schedule, 1, 2, 3)
    assert note.times == [("begin", 1)]
    assert schedule.active == (fault,)


def test_a_fault_begins_and_ends_in_its_ticks(schedule):
    note, fault = add(schedule, at=0.003, duration=0.002)
    run(schedule, *range(10))
    assert note.times == [("begin", 3), ("end", 5)]
    assert schedule.active == ()
    assert not fault.is_active


@pytest.mark.parametrize(
    ("times", "first", "begin", "end"),
    [
        ({"at": 0.0025, "duration": 0.0012}, 0, 3, 4),  # 3.7 ms is after tick 3
        ({"duration": 0.002}, 7, 7, 9),  # it counts from the first tick
        ({"at": 0.001, "duration": 1e-9}, 1, 1, 2),  # a tick at least
        ({"duration": 0.0}, 1, 1, 2),
    ],
)
def test_times_between_ticks_act_at_the_next(schedule, times, first, begin, end):
    note, _ = add(schedule, **times)
    run(schedule, *range(first, first + 5))
    assert note.times == [("begin", begin), ("end", end)]


def test_a_fault_to_come_is_due_at_its_time(schedule):
    note, _ = add(schedule, at=1.002, duration=0.001)
    assert schedule.due == 1002 * MS
    run(schedule, 1001, 1002, 1003)
    assert note.times == [("begin", 1002), ("end", 1003)]


def test_a_time_that_has_passed_is_now(schedule):
    run(schedule, 1, 2)
    note, _ = add(schedule, at=0.001)
    run(schedule, 8)
    assert note.times == [("begin", 8)]


def test_a_cleared_fault_ends_at_once_and_once(schedule):
    note, fault = add(schedule)
    run(schedule, 1)
    run(schedule, 2, 3, 4)
    fault.clear()
    fault.clear()
    run(schedule, 5)
    assert note.times == [("begin", 1), ("end", 4)]
    assert [event.time for event in schedule.events] == [1 * MS, 4 * MS]


def test_a_fault_that_is_cleared_before_never_begins(schedule):
    note, fault = add(schedule, at=0.005)
    fault.clear()
    run(schedule, *range(10))
    assert note.times == []


def test_a_block_ends_its_fault_even_by_an_error(schedule):
    _, fault = add(schedule)

    def fail_within():
        with fault:
            run(schedule, 1)
            assert fault.is_active
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_within()
    assert not fault.is_active


def test_all_faults_are_cleared_together(schedule):
    notes = [add(schedule)[0], add(schedule)[0], add(schedule, at=0.5)[0]]
    run(schedule, 1)
    schedule.clear()
    assert [note.times for note in notes] == [[("begin", 1), ("end", 1)]] * 2 + [[]]
    assert schedule.due == NEVER


def test_what_ends_does_so_before_what_begins(schedule):
    order = []

    class Ordered(Note):
        def __init__(self, name):
            super().__init__()
            self.name = name

        def begin(self, _now):
            order.append(f"begin {self.name}")

        def end(self, _now):
            order.append(f"end {self.name}")

    schedule.add("freeze", "a", Ordered("late"), at=0.002)
    schedule.add("freeze", "a", Ordered("early"), at=0.001, duration=0.001)
    run(schedule, 1, 2)
    assert order == ["begin early", "end early", "begin late"]


@pytest.mark.parametrize("when", [{"at": -1.0}, {"duration": float("nan")}, {"at": float("inf")}])
def test_impossible_times_are_refused(schedule, when):
    with pytest.raises(ConfigError, match=next(iter(when))):
        add(schedule, **when)
    assert schedule.due == NEVER


def test_what_began_and_ended_is_kept(schedule):
    add(schedule, at=0.001, duration=0.002)
    _, other = add(schedule, at=0.002)
    run(schedule, 1, 2, 3)
    other.clear()
    assert [(time // MS, is_begin) for time, _, is_begin in schedule.events] == [
        *((1, True), (2, True), (3, False), (3, False))
    ]
    assert {event.name for event in schedule.events} == {"freeze sensor"}


def test_a_fault_says_what_it_is(schedule):
    _, fault = add(schedule)
    assert repr(fault) == "<Fault freeze sensor, not active>"
    run(schedule, 1)
    assert repr(fault) == "<Fault freeze sensor, active>"
