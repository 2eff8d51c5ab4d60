"""Controllers on a session: what each hears, when what it sends acts, and its power."""

import os
from pathlib import Path

import pytest

from hil_bench import ControllerEnd, ControllerKind, TimedFrame, load_config
from hil_bench.abilities.controllers import turns
from hil_bench.abilities.controllers.desk import ControllerConfig, Desks
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ControllerError

TICK = 1_000_000
MASTER = Frame(0x123, b"\1")
TWO_BUSES = Path(__file__).parents[3] / "examples/two_buses.toml"


class Probe:
    """A controller that sends what it is told to and keeps what it hears."""

    has_begun = True

    def __init__(self, sends, log):
        self.sends, self.log = sends, log

    def advance(self, until, received):
        self.log.append((until, [each for each in received if each.frame.can_id < 0x700]))
        wanted = self.sends.get(until, ())
        if isinstance(wanted, Exception):
            raise wanted
        return wanted

    def reset(self):
        self.log.append("reset")

    def tail(self):
        return ""

    def close(self):
        self.log.append("closed")


class AlternatingProbe(Probe):
    partner = 123_456


class ProbeKind(ControllerKind):
    name = summary = "probe"

    def problems(self, *_):
        return ()

    def build(self, settings, surroundings):
        settings["log"].append(("built", surroundings.buses, surroundings.scratch.name))
        made = AlternatingProbe if settings["sends"].get("separate") else Probe
        return made(settings["sends"], settings["log"])


def make_desks(tmp_path, sends, *, buses=None, file=None):
    """Return a session, its desks and the log of each controller."""
    config = load_config(file)
    session = open_session(config)
    logs = {name: [] for name in sends}
    configs = [
        ControllerConfig(
            name,
            ProbeKind(),
            {"sends": sends[name], "log": logs[name]},
            (buses or {}).get(name, tuple(config.buses)),
            (),
            "",
            tmp_path,
        )
        for name in sends
    ]
    desks = Desks(configs, session, config, tmp_path)
    session.start()
    return session, desks, logs


def run(session, ticks):
    """Run ticks and return the frames that come from this process, by tick."""
    return {tick: session.tick((), tick * TICK) for tick in range(ticks)}


def at(tick, frame=MASTER):
    return {tick * TICK: [TimedFrame(tick * TICK, frame)]}


def heard(log):
    return {until // TICK: [f for _, f in frames] for until, frames in log[1:] if frames}


def test_what_one_sends_acts_in_the_tick_and_the_other_hears_it_in_the_next(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": at(2), "b": {}})
    sent = run(session, 5)
    assert MASTER in sent[2]
    assert heard(logs["b"]) == {3: [MASTER]}  # with the time of tick 2
    assert [each.time for until, each_ in logs["b"][1:] for each in each_] == [2 * TICK]


def test_none_hears_itself_even_where_two_send_the_same(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": at(2), "b": at(2)})
    run(session, 5)
    assert heard(logs["a"]) == {3: [MASTER]}
    assert heard(logs["b"]) == {3: [MASTER]}


def test_frames_act_in_order_of_their_times_then_of_names(tmp_path):
    late, early = TimedFrame(2 * TICK, Frame(1)), TimedFrame(2 * TICK - 5, Frame(2))
    same = TimedFrame(2 * TICK, Frame(3))
    sends = {"b": {2 * TICK: [same]}, "a": {2 * TICK: [late, early]}}
    session, _, _ = make_desks(tmp_path, sends)
    assert [frame.can_id for frame in run(session, 3)[2]] == [2, 1, 3]


def test_a_controller_counts_its_own_buses(tmp_path):
    session, _, logs = make_desks(
        tmp_path, {"a": at(2), "b": at(3)}, buses={"a": ("sensors",)}, file=TWO_BUSES
    )
    sent = run(session, 6)
    assert MASTER._replace(bus=1) in sent[2]  # its first is the second of the bench
    assert heard(logs["b"]) == {3: [MASTER._replace(bus=1)]}
    assert heard(logs["a"]) == {}  # b sends on the first one


@pytest.mark.parametrize("bus", [-1, 1])
def test_a_frame_on_a_bus_that_it_does_not_have_ends_the_run(tmp_path, bus):
    session, _, _ = make_desks(tmp_path, {"a": at(1, MASTER._replace(bus=bus))})
    with pytest.raises(
        ControllerError, match=f"controller a: the controller sent on its bus {bus}, but has 1"
    ):
        run(session, 2)


def test_an_error_says_whose_it_is(tmp_path):
    session, _, _ = make_desks(tmp_path, {"a": {TICK: ControllerError("out of memory")}})
    with pytest.raises(ControllerError, match=r"^controller a: out of memory$"):
        run(session, 2)


def test_the_last_frames_of_one_that_ends_still_act(tmp_path, caplog):
    end = ControllerEnd("all done", [TimedFrame(2 * TICK, MASTER)])
    session, desks, logs = make_desks(tmp_path, {"a": {2 * TICK: end}})
    assert MASTER in run(session, 4)[2]
    assert desks.ending == "controller a: the controller ended: all done"
    assert caplog.messages == ["0.002 s: controller a: has ended: all done"]
    assert logs["a"][-1] == "closed"


def test_power_is_switched_by_name(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": {}, "b": {}})
    run(session, 2)
    session.switches["a"]("kill")
    session.switches["a"]("kill")  # is off already
    session.tick((), 2 * TICK)
    session.switches["a"]("start")
    session.switches["a"]("start")  # is on already
    session.tick((), 3 * TICK)
    session.switches["a"]("restart")
    session.tick((), 4 * TICK)
    built = ("built", ("bus",))
    log = [each if isinstance(each, str) else each[:2] for each in logs["a"]]
    times = [each[0] for each in log if isinstance(each[0], int)]
    assert times == [TICK, 3 * TICK, 4 * TICK]  # dead in tick 2
    assert log.count("reset") == log.count("closed") == 2
    assert [each for each in log if each == built] == [built] * 3
    assert "closed" not in logs["b"]


def test_one_that_was_without_power_has_heard_nothing_meanwhile(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": {}, "b": at(2)})
    run(session, 2)
    session.switches["a"]("kill")
    for tick in (2, 3):
        session.tick((), tick * TICK)
    session.switches["a"]("start")
    session.tick((), 4 * TICK)
    assert logs["a"][-1] == (4 * TICK, [])


def test_each_start_has_a_folder_of_its_own(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": {}})
    run(session, 2)
    session.switches["a"]("restart")
    session.tick((), 2 * TICK)
    assert [each[2] for each in logs["a"] if each[0] == "built"] == ["1", "2"]


def test_ticks_that_a_late_loop_skips_are_no_time_for_a_controller(tmp_path):
    session, _, logs = make_desks(tmp_path, {"a": {}, "b": at(3)})
    for tick in (0, 1, 2, 7, 8):  # 3 to 6 are skipped
        session.tick((), tick * TICK)
    assert [until for until, _ in logs["a"][1:]] == [TICK, 2 * TICK, 3 * TICK, 4 * TICK]
    assert logs["a"][-1][1] == [TimedFrame(3 * TICK, MASTER)]


def test_the_bench_takes_turns_with_a_process_until_they_are_closed(tmp_path, monkeypatch):
    places = {}
    monkeypatch.setattr(turns.linux, "threads", lambda thread: [thread])
    monkeypatch.setattr(turns.linux, "processor", lambda: 1)
    monkeypatch.setattr(os, "sched_getaffinity", lambda thread: places.get(thread, {0, 1}))
    monkeypatch.setattr(os, "sched_setaffinity", places.__setitem__)
    session, desks, _ = make_desks(tmp_path, {"here": {}, "separate": {"separate": True}})
    for tick in range(turns.PERIOD + 2):
        session.tick((), tick * TICK)
    assert places[AlternatingProbe.partner] == {1}
    desks.close()
    assert places[AlternatingProbe.partner] == {0, 1}
