"""The feed of work that is no running bench: a commissioning, a twin, tests, a campaign."""

import pytest
from support.feed_loop import Wire

from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.common.work import MOST_ITEMS, WorkItem, WorkState
from hil_bench.abilities.live.client import FeedClient
from hil_bench.abilities.live.ctl import status_lines
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedServer
from hil_bench.abilities.live.view import WorkFeed
from hil_bench.errors import ConfigError

HELLO = {
    "name": "commission",
    "channels": [["axis1.position", "m"]],
    "nodes": [],
    "work": {"verb": "commission", "title": "plan.toml"},
}


class WorkLoop:
    """The feed and its server in one thread; it stands where the process would be."""

    def __init__(self):
        self.stops = 0
        self.is_served = True
        self.plan = FeedPlan(HELLO, 2, SharedRing(CAPACITY), SharedRing(MOST_COMMANDS))
        self.server = FeedServer(self.plan)
        self.feed = WorkFeed(self, self.plan, self.count_stop)

    def count_stop(self):
        self.stops += 1

    def look(self):
        return self.is_served

    def stop(self):
        self.is_served = False
        self.server.poll()

    def tick(self, count=1):
        for _ in range(count):
            self.feed.look()
            self.server.poll()

    def connect(self):
        return FeedClient("commission", Wire(self), 1.0)


@pytest.fixture
def loop():
    return WorkLoop()


def watching(loop, **wishes):
    wire = Wire(loop)
    wire.say(id=1, do="watch", **wishes)
    loop.tick(2)
    return wire


def states(wire):
    return [line for line in wire.lines() if line["type"] == "state"]


def test_a_client_sees_what_is_done_and_what_it_found(loop):
    loop.feed.show(
        WorkState(
            now="ramp",
            detail="position 10 to 190 mm",
            done=1,
            total=2,
            counts={"passed": 1},
            items=[WorkItem("sensors", "passed"), WorkItem("ramp", "runs")],
            limits={"axis1.position": (0.01, 0.19)},
        )
    )
    wire = watching(loop)
    (state,) = states(wire)
    assert (state["nodes"], state["faults"], state["recording"]) == ({}, [], None)
    rest = {
        "unit": "",
        "left": None,
        "margins": [],
        "histograms": [],
        "courses": [],
        "failures": [],
    }
    assert state["work"] == {
        **rest,
        "now": "ramp",
        "detail": "position 10 to 190 mm",
        "done": 1,
        "total": 2,
        "counts": {"passed": 1},
        "items": [
            {"name": "sensors", "verdict": "passed", "text": ""},
            {"name": "ramp", "verdict": "runs", "text": ""},
        ],
        "limits": {"axis1.position": [0.01, 0.19]},
        "verdict": "",
    }


def test_a_state_comes_twice_a_second_at_the_most_and_only_where_it_is_new(loop):
    wire = watching(loop)
    (first,) = states(wire)
    assert (first["work"]["done"], first["work"]["total"]) == (0, 0)
    for done in range(1, 11):
        loop.feed.show(WorkState(done=done, total=10))
        loop.tick()
    assert len(states(wire)) == 2
    loop.tick(5)
    (last,) = states(wire)
    assert last["work"]["done"] == 10
    loop.tick(20)
    assert states(wire) == []


def test_rows_go_to_who_wants_each_of_them_and_the_newest_to_everybody(loop):
    all_rows, none = watching(loop, rows_every_s=0), watching(loop)
    for number in range(3):
        loop.feed.put_row((0.1 * number, 0.5))
    loop.tick()
    rows = [row for line in all_rows.lines() if line["type"] == "rows" for row in line["rows"]]
    assert rows == [[0.0, 0.5], [0.1, 0.5], [0.2, 0.5]]
    assert [line for line in none.lines() if line["type"] == "rows"] == []
    with loop.connect() as client:
        assert client.request("status")["values"] == {"time": 0.2, "axis1.position": 0.5}


def test_rows_that_nobody_watches_are_not_passed_on(loop):
    loop.feed.put_row((0.1, 0.5))
    assert list(loop.plan.up.take()) == []


def test_the_status_in_the_shell_has_a_line_for_it(loop):
    loop.feed.show(WorkState(now="ramp\x1b[2J", done=13.84, total=23.0944, unit="s"))
    loop.feed.put_row((0.2, 0.5))
    with loop.connect() as client:
        hello = {**client.hello, "pid": 1, "bench": "commission plan.toml"}
        lines = [*status_lines(hello, client.request("status"))]
    assert lines == [  # and none of a loop, nor of faults, which this work has not
        "bench  commission  process 1, commission plan.toml, at 0.200 s",
        "value  axis1.position      500.00 mm",
        "work   13.84 of 23.0944 s  ramp\\x1b[2J",
    ]


def test_stop_is_answered_before_it_acts(loop):
    with loop.connect() as client:
        client.request("stop")
    assert loop.stops == 1


def test_marks_are_seen_and_kept(loop):
    wire = watching(loop)
    loop.feed.put_row((1.5, 0.0))
    with loop.connect() as client:
        client.request("mark", text="here")
        (entry,) = client.request("journal")["entries"]
    assert (entry["time"], entry["fields"]) == (1.5, {"text": "here"})
    assert [line["do"] for line in wire.lines() if line["type"] == "command"] == ["mark"]


def test_what_only_a_bench_can_do_is_refused(loop):
    with (
        loop.connect() as client,
        pytest.raises(
            ConfigError,
            match="start_recording: this is commission, no running bench; it takes mark, status",
        ),
    ):
        client.request("start_recording", path="/x.mf4")


def test_items_have_an_end(loop):
    loop.feed.show(WorkState(items=[WorkItem(str(number)) for number in range(MOST_ITEMS + 1)]))
    (state,) = states(watching(loop))
    assert len(state["work"]["items"]) == MOST_ITEMS


def test_nobody_watches_so_nothing_is_published(loop):
    with loop.feed:
        loop.feed.put_row((0.0, 0.0))
    assert not list(loop.plan.up.take())


def test_its_last_state_comes_before_its_end(loop):
    wire = watching(loop)
    states(wire)
    with loop.feed:
        loop.feed.show(WorkState(verdict="passed"))
    assert states(wire)[-1]["work"]["verdict"] == "passed"
