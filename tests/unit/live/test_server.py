"""The server of the feed and its clients: hostile, slow, many, gone."""

import itertools
import json

import pytest
from support.feed_loop import FeedLoop, Wire

from hil_bench.abilities.faults.fault import MOST_FAULTS
from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.live.client_link import MOST_OPEN
from hil_bench.abilities.live.messages import MOST_REQUEST
from hil_bench.abilities.live.server import MOST_CLIENTS
from hil_bench.canopen_device.frame import Frame


@pytest.fixture
def loop():
    return FeedLoop()


def of(kind, messages):
    return [message for message in messages if message["type"] == kind]


def test_a_client_is_greeted(loop):
    (hello,) = Wire(loop).lines()
    assert (hello["type"], hello["version"], hello["name"]) == ("hello", 1, "bench")
    assert hello["channels"][0] == ["axis1.position", "m"]
    assert hello["nodes"] == ["valve", "pressure_a", "pressure_b", "position"]
    assert [each["name"] for each in hello["axes"]["axis1"]] == ["load", "supply_pressure"]


def test_nobody_there_costs_nothing(loop):
    loop.tick(300)
    assert loop.session._row_observers == loop.session._frame_observers == []
    assert list(loop.plan.up.take()) == []


def test_every_tick_is_a_row_for_who_wants_all(loop):
    wire = Wire(loop)
    wire.say(id=1, do="watch", rows_every_s=0)
    loop.tick(11)
    rows = [row for message in of("rows", wire.lines()) for row in message["rows"]]
    times = [round(row[0] * 1e3) for row in rows]
    # Tick 1 lets the loop hear of the wish at its end; from tick 2 on each tick makes a row.
    assert times[-10:] == list(range(2, 12))
    assert len(rows[0]) == 1 + len(loop.session.channels)


def test_rows_are_thinned_by_bench_time(loop):
    fast, slow = Wire(loop), Wire(loop)
    fast.say(id=1, do="watch", rows_every_s=0)
    slow.say(id=1, do="watch", rows_every_s=0.005)
    loop.tick(200)
    rows = [row for message in of("rows", slow.lines()) for row in message["rows"]]
    steps = {round((b[0] - a[0]) * 1e3) for a, b in itertools.pairwise(rows[1:])}
    assert steps == {5}


def test_rows_of_a_bench_that_begins_anew_are_shown_at_once(loop):
    wire = Wire(loop)
    wire.link.rows_every = 0.005
    for time in (10.0, 0.0, 0.001, 0.005):
        wire.link.show_row(time, b"[%g]" % time)
    wire.link.flush()
    assert [message["rows"] for message in of("rows", wire.lines())] == [[[10], [0], [0.005]]]


def test_the_loop_stops_when_the_last_client_goes(loop):
    wires = [Wire(loop), Wire(loop)]
    for wire in wires:
        wire.say(id=1, do="watch", rows_every_s=0, frames=True)
    loop.tick(2)
    assert len(loop.session._row_observers) == len(loop.session._frame_observers) == 1
    wires[0].close()
    loop.tick(2)
    assert len(loop.session._row_observers) == 1
    wires[1].close()
    loop.tick(2)
    assert loop.session._row_observers == loop.session._frame_observers == []


def test_a_server_that_has_died_is_no_client(loop):
    Wire(loop).say(id=1, do="watch", rows_every_s=0)
    loop.tick(2)
    assert loop.session._row_observers
    loop.is_served = False
    loop.look_again()
    assert loop.session._row_observers == []


def test_frames_go_both_ways(loop):
    wire = Wire(loop)
    wire.say(id=1, do="watch", frames=True)
    loop.tick(2)
    wire.lines()
    loop.session.serve([Frame(0x601, bytes.fromhex("4000100000000000"))])
    loop.server.poll()
    asked, answered = of("frames", wire.lines())
    (ask,), (answer,) = asked["frames"], answered["frames"]
    # CiA 301, 7.2.4.3.5: upload of 0x1000:00 from node 1.
    assert ask[1:] == [0, "in", 0x601, "4000100000000000", False, False, 0]
    assert answer[1:4] == [0, "out", 0x581]


def test_a_fault_is_an_event_and_a_state(loop):
    wire = Wire(loop)
    wire.say(id=1, do="watch")
    loop.tick(2)
    wire.say(id=2, do="begin_fault", kind="offset", target="pressure_a", arguments={"amount": 1e5})
    loop.look_again()
    messages = wire.lines()
    answer = next(m for m in of("answer", messages) if m["id"] == 2)
    (event,) = of("event", messages)
    assert event["kind"] == "offset"
    assert event["begins"] is True
    (fault,) = of("state", messages)[-1]["faults"]
    assert fault["number"] == answer["value"]
    assert (fault["kind"], fault["target"], fault["ends"]) == ("offset", "pressure_a", None)
    wire.say(id=3, do="clear_fault", number=fault["number"])
    loop.look_again()
    assert of("state", wire.lines())[-1]["faults"] == []


def test_a_state_comes_once_until_it_is_another(loop):
    wire = Wire(loop)
    wire.say(id=1, do="watch")
    loop.tick(500)
    assert len(of("state", wire.lines())) == 1
    loop.session.bench.part(Faults).freeze("position")
    loop.tick(500)
    assert len(of("state", wire.lines())) == 1


def test_who_comes_after_a_fault_sees_its_state_and_not_its_event(loop):
    loop.session.bench.part(Faults).freeze("pressure_a")
    loop.tick(2)
    wire = Wire(loop)
    wire.say(id=1, do="watch")
    loop.look_again()
    messages = wire.lines()
    assert of("event", messages) == []
    assert [fault["kind"] for fault in of("state", messages)[-1]["faults"]] == ["freeze"]


def test_a_bench_goes_on_until_somebody_stops_it(loop):
    wire = Wire(loop)
    loop.tick(2)
    assert not loop.session.controls.is_over
    wire.say(id=1, do="stop")
    loop.tick(2)
    assert loop.session.controls.is_over


def test_a_planned_fault_gets_a_number_too(loop):
    loop.session.bench.part(Faults).freeze("pressure_a")
    wire = Wire(loop)
    wire.say(id=1, do="status")
    loop.look_again()
    (answer,) = of("answer", wire.lines())
    (fault,) = answer["value"]["state"]["faults"]
    wire.say(id=2, do="clear_fault", number=fault["number"])
    loop.tick(2)
    assert loop.session.bench.part(Faults).active == ()


def test_a_wrong_line_gets_an_answer_and_the_next_one_too(loop):
    wire = Wire(loop)
    wire.lines()
    wire.link.data_received(b'\x00\xff\n{"id":5,"do":"fly"}\n{"id":6,"do":"get_obj')
    wire.link.data_received(b'ect","node":"nobody","name":"0x1000"}\n')
    loop.tick(2)
    first, second, third = of("answer", wire.lines())
    assert first["id"] is None
    assert "is not JSON" in first["error"]
    assert second["id"] == 5
    assert "give one of status" in second["error"]
    assert third["id"] == 6
    assert 'there is no node "nobody"' in third["error"]
    assert third["kind"] == "usage"
    assert not wire.is_closed


@pytest.mark.parametrize("ending", [b"", b"\n"])
def test_a_request_without_an_end_is_cut_off(loop, ending):
    wire = Wire(loop)
    wire.lines()
    for _ in range(MOST_REQUEST // 4096):
        wire.link.data_received(b"x" * 4096)
    wire.link.data_received(ending) if not wire.is_closed else None
    (error,) = wire.lines()
    assert error["type"] == "error"
    assert f"{MOST_REQUEST} bytes at most" in error["error"]
    assert wire.is_closed
    assert loop.server.clients == []


def test_there_is_room_for_so_many_clients(loop):
    wires = [Wire(loop) for _ in range(MOST_CLIENTS)]
    for wire in wires:
        wire.say(id=1, do="watch")
    one_more = Wire(loop)
    assert one_more.is_closed
    (error,) = one_more.lines()
    assert error["error"] == f"{MOST_CLIENTS} clients are connected already; close one"
    wires[0].close()
    assert not Wire(loop).is_closed


def test_clients_that_have_never_asked_make_room_the_oldest_first(loop):
    asker = Wire(loop)
    asker.say(id=1, do="watch")
    babbler = Wire(loop)
    babbler.say(id=1, do="watch")
    babbler.sendall(b"\xff\n")
    idlers = [Wire(loop) for _ in range(MOST_CLIENTS - 2)]
    newcomers = [Wire(loop) for _ in range(2)]
    assert [wire.is_closed for wire in (asker, babbler, *idlers[:2])] == [False, True, True, False]
    assert [of("hello", wire.lines()) != [] for wire in newcomers] == [True, True]
    assert len(loop.server.clients) == MOST_CLIENTS


def test_fifty_clients_see_the_same(loop):
    wires = [Wire(loop) for _ in range(50)]
    for wire in wires:
        wire.say(id=1, do="watch", rows_every_s=0)
    loop.tick(20)
    seen = {json.dumps(of("rows", wire.lines())) for wire in wires}
    assert len(seen) == 1


def test_a_slow_client_loses_of_its_own_picture_only(loop):
    slow, quick = Wire(loop, room=5000), Wire(loop)
    for wire in (slow, quick):
        wire.say(id=1, do="watch", rows_every_s=0)
    loop.tick(200)
    assert len(slow.out) < 5000 + 4000  # the line that filled it, and no more
    assert not slow.is_reading
    rows = [row for message in of("rows", quick.lines()) for row in message["rows"]]
    seen = of("rows", before := slow.lines())
    (lost,) = of("lost", before)
    kept = sum(len(message["rows"]) for message in seen)
    assert kept + lost["rows"] == len(rows)
    assert lost["rows"] > 0
    assert slow.is_reading
    loop.tick(1)
    assert of("rows", slow.lines())


def test_what_a_slow_client_loses_is_counted_by_its_kind(loop):
    wire = Wire(loop)
    wire.lines()
    wire.link.rows_every = 0.0
    wire.link.pause_writing()
    wire.link.show(b"{}\n")
    wire.link.show(b"{}\n")
    wire.link.show(b"{}\n", frames=3)
    wire.link.show_row(0.0, b"[0]")
    wire.link.flush()
    wire.link.resume_writing()
    assert wire.lines() == [{"type": "lost", "rows": 1, "frames": 3, "others": 2}]


def test_requests_of_a_client_wait_for_their_answers(loop):
    wire = Wire(loop)
    loop.tick(1)
    wire.lines()
    count = 3 * MOST_OPEN
    request = b'{"id":1,"do":"get_object","node":"valve","name":"0x1000"}\n'
    wire.link.data_received(request * count)
    assert len(loop.server._open) == MOST_OPEN
    assert not wire.is_reading
    loop.tick(1)  # four of them go to the door, see MOST_AT_ONCE
    assert len(loop.session.door.waiting) == 4
    loop.tick(count)
    assert len(of("answer", wire.lines())) == count
    assert wire.is_reading


def test_a_client_that_goes_takes_its_answer_with_it(loop):
    wire = Wire(loop)
    wire.say(id=1, do="begin_fault", kind="freeze", target="pressure_a")
    wire.close()
    loop.tick(3)
    assert [fault.target for fault in loop.session.bench.part(Faults).active] == ["pressure_a"]
    assert loop.server._open == {}


def test_no_text_is_too_odd_for_an_answer(loop):
    wire = Wire(loop)
    loop.tick()
    wire.lines()
    # A lone surrogate is JSON, but not UTF-8.
    odd = b'{"id":1,"do":"begin_fault","kind":"\\ud800","target":"a"}\n'
    wire.link.data_received(odd + b'{"id":2,"do":"\\ud800"}\n')
    loop.tick(2)
    errors = {m["id"]: m["error"] for m in of("answer", wire.lines())}
    assert r'there is no kind "\ud800"' in errors[1]
    assert r"do = '\ud800'" in errors[2]


def test_faults_do_not_pile_up(loop):
    wire = Wire(loop)
    for _ in range(MOST_FAULTS):
        fault = {"kind": "freeze", "target": "pressure_a", "arguments": {"at": 1e3}}
        wire.say(id=1, do="begin_fault", **fault)
        loop.tick(2)
    assert all("error" not in message for message in of("answer", wire.lines()))
    wire.say(id=2, do="begin_fault", kind="freeze", target="pressure_b")
    loop.tick(2)
    (answer,) = of("answer", wire.lines())
    assert answer["error"] == f"fault: {MOST_FAULTS} are there or planned already; clear one"


def test_commands_beyond_the_room_are_refused(loop):
    wires = [Wire(loop) for _ in range(60)]
    text = "x" * (MOST_REQUEST - 200)
    for wire in wires:
        wire.say(id=1, do="get_object", node="valve", name=text)
    refused = [of("answer", wire.lines()) for wire in wires]
    assert any("takes no command at present" in m["error"] for ms in refused for m in ms)
