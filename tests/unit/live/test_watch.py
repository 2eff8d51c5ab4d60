"""`hil-bench watch`: what the terminal shows, and a bench that ends and comes back."""

import sys

import pytest
from rich.console import Console
from support.feed_loop import FeedLoop

from hil_bench import BusError, Faults
from hil_bench.abilities.common.terminal import bar
from hil_bench.abilities.live import watch
from hil_bench.abilities.live.watch import WatchView


@pytest.fixture
def loop(monkeypatch):
    loop = FeedLoop()
    monkeypatch.setattr(watch, "connect", loop.connect)
    return loop


def drawn(view, width=120):
    console = Console(width=width, markup=False, emoji=False, highlight=False)
    with console.capture() as capture:
        console.print(view.render())
    return [line.rstrip() for line in capture.get().splitlines()]


def hello(name="bench", channel="axis1.position"):
    return {"name": name, "pid": 7, "channels": [[channel, "m"]], "nodes": [], "axes": {}}


def state(**node):
    return {"type": "state", "nodes": node, "faults": []}


def test_one_picture_has_it_all(loop, cli):
    loop.session.bench.part(Faults).freeze("pressure_a", duration=60.0)
    loop.look_again()
    lines = cli("watch --once").out.splitlines()
    assert lines[0].startswith("bench  bench, process ")
    for channel in loop.session.channels:
        assert any(line.startswith(channel.name + " ") for line in lines)
    assert any(line.split() == ["pressure_b", "PRE-OPERATIONAL"] for line in lines)
    assert any("freeze pressure_a since 0.001 s, until 60.001 s" in line for line in lines)
    assert any(line.startswith("loop   ") for line in lines)


def test_a_bar_is_as_full_as_the_value_lies():
    expected = {
        0.0: "    ",
        4.0: "████",
        2.0: "██  ",
        2.5: "██▌ ",
        -1.0: "    ",
        9.0: "████",
        None: "    ",
    }
    assert {value: bar(value, 0.0, 4.0, width=4) for value in expected} == expected


def test_a_bar_of_one_value_is_empty():
    assert bar(1.0, 1.0, 1.0, width=4) == "    "
    assert bar(1.0, float("nan"), float("nan"), width=4) == "    "


def test_the_range_is_that_of_what_was_seen():
    view = WatchView(hello())
    for value in (0.1, 0.3, None, 0.2):
        view.take({"type": "rows", "rows": [[1.0, value]]})
    (line,) = [line.split() for line in drawn(view) if line.startswith("axis1.position")]
    assert line[:4] == ["axis1.position", "200.00", "mm", "100.00"]
    assert line[-1] == "300.00"


def test_what_happens_is_listed():
    view = WatchView(hello())
    event = {"type": "event", "time": 1.5, "kind": "freeze", "target": "a", "begins": True}
    view.take(event)
    view.take({**event, "begins": False, "time": 2.0})
    view.take({"type": "lost", "rows": 3, "frames": 0, "others": 1})
    lines = drawn(view)
    assert "event  1.500 s: freeze a begins" in lines
    assert "event  2.000 s: freeze a ends" in lines
    assert "4 messages lost: this terminal is too slow" in lines


def test_the_loop_is_shown_in_numbers():
    view = WatchView(hello())
    times = {"p99_us": 12.3, "max_us": 45.6}
    view.take(
        {
            "type": "health",
            "lateness": times,
            "work": times,
            "overruns": 2,
            "skipped": 0,
            "bus_load": 0.123,
        }
    )
    assert drawn(view)[-1] == (
        "loop   late p99 12 max 46 us  work p99 12 max 46 us  2 overran  0 skipped  bus 12.3 %"
    )


def test_texts_from_outside_stay_texts():
    hostile = "[bold]\x1b[2J:smile:"
    view = WatchView(hello(name=hostile, channel=hostile))
    node = {"state": "OPERATIONAL", "device": hostile, "errors": [0x8130]}
    fault = {
        "number": 1,
        "kind": "freeze",
        "target": hostile,
        "begins": 1.0,
        "ends": None,
        "is_idle": False,
    }
    view.take({**state(**{hostile: node}), "faults": [fault]})
    text = "\n".join(drawn(view))
    assert "\x1b" not in text
    assert text.count("[bold]\\x1b[2J:smile:") == 5
    assert "EMCY 0x8130" in text


def test_a_bench_that_ends_is_waited_for(loop):
    client = loop.connect()
    view = WatchView(client.hello)
    waits = []
    answers = iter([BusError("no bench"), BusError("no bench"), None])

    def reconnect():
        error = next(answers)
        if error is not None:
            raise error
        return loop.connect()

    pictures = watch.views(client, view, reconnect, waits.append)
    next(pictures)
    assert view.is_there
    for link in list(loop.server.clients):
        link.close()
    while view.is_there:
        next(pictures)
    assert "has ended; waiting for it" in drawn(view)[0]
    while not view.is_there:
        next(pictures)
    assert len(waits) == 3
    assert "waiting" not in drawn(view)[0]


def test_time_that_stands_still_is_said(loop):
    client = loop.connect()
    view = WatchView(client.hello)
    pictures = watch.views(client, view, loop.connect, lambda _time: None)
    next(pictures)
    loop.tick = lambda: None
    while view.is_moving:
        next(pictures)
    assert "its time stands still" in drawn(view)[0]


def test_without_its_library_it_says_what_to_install(monkeypatch, cli):
    monkeypatch.setitem(sys.modules, "rich.console", None)
    assert "watch needs rich, which is missing; pip install 'hil-bench[watch]'" in (
        cli("watch", 2).err
    )


def test_axes_stand_side_by_side_in_their_units():
    channels = [[f"{axis}.{name}", "m"] for axis in ("a", "b") for name in ("position", "stroke")]
    view = WatchView({**hello(), "axes": {"a": {}, "b": {}}, "channels": [*channels, ["t", "°C"]]})
    view.take({"type": "rows", "rows": [[1.0, 0.1, 0.2, 0.3, 0.4, 45.0]]})
    lines = [line.split() for line in drawn(view)]
    assert ["axis", "position", "[mm]", "stroke", "[mm]"] in lines
    assert ["a", "100.00", "200.00"] in lines
    assert ["b", "300.00", "400.00"] in lines
    assert ["t", "45.0", "°C", "45.0", "45.0"] in lines


def margin(**changes):
    band = {"channel": "axis1.position", "low": None, "high": 0.07, "begin": 0.0, "end": None}
    band["is_strict"] = True
    return {
        "id": "SRS-1",
        "verdict": "",
        "margin": 0.25,
        "text": "0.1 mm, since 1.20 s",
        "bands": [{**band, **changes}],
    }


def work(**changes):
    content = {"now": "moves", "detail": "", "done": 1.2, "total": 2.5, "unit": "s", "left": None}
    rest = {"counts": {}, "items": [], "limits": {}, "margins": [], "verdict": ""}
    return {"type": "state", "nodes": {}, "faults": [], "work": {**content, **rest, **changes}}


def test_a_running_scenario_shows_time_margins_and_limits():
    view = WatchView({**hello(), "work": {"verb": "scenario", "is_bench": True}})
    view.take({"type": "rows", "rows": [[1.0, 0.05]]})
    view.take(work(margins=[margin()]))
    lines = drawn(view)
    assert "scenario  1.2 of 2.5 s  moves" in lines
    assert any(line.split()[:2] == ["SRS-1", "holds"] and "0.1 mm" in line for line in lines)
    assert any(line.endswith("up to 70 mm") for line in lines)


@pytest.mark.parametrize("change", [{"begin": 1.8}, {"end": 0.5}, {"is_strict": False}])
def test_a_limit_that_does_not_hold_now_is_not_shown(change):
    view = WatchView({**hello(), "work": {"verb": "scenario", "is_bench": True}})
    view.take({"type": "rows", "rows": [[1.0, 0.5]]})
    view.take(work(margins=[margin(**change)]))
    assert not any("70 mm" in line for line in drawn(view))


def test_work_without_a_bench_has_no_nodes_and_its_limits_in_the_chosen_units(monkeypatch):
    monkeypatch.setenv("HIL_BENCH_UNITS", "in")
    view = WatchView({**hello(), "work": {"verb": "campaign"}})
    view.take({"type": "rows", "rows": [[1.0, 0.0508]]})
    view.take(work(limits={"axis1.position": [0.0254, 0.254]}, left=95.0, counts={"failed": 2}))
    lines = drawn(view)
    assert "campaign  1.2 of 2.5 s  moves, 95 s left" in lines
    assert "so far  2 failed" in lines
    # By definition an inch is 25.4 mm.
    assert any("2.0000  in" in line and line.endswith("1 to 10 in") for line in lines)
    assert not any(line.startswith(("node", "fault", "loop")) for line in lines)
