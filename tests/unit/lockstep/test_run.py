"""`hil-bench run --lockstep` with a controller whose frames are all there already."""

import contextlib
import re

import pytest
from support.tables import from_text

from hil_bench.abilities.live.messages import COMMAND, encode
from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.abilities.lockstep.run import LockStepStatus
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.cli.run_setup import RunSetup
from hil_bench.cli.status_line import format_lines
from hil_bench.errors import BusError
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.transports.transport import TransportCounters

SYNC = Frame(0x080)
START_ALL = Frame(0x000, b"\x01\x00")


class Controller:
    """A bus with a controller that never waits, and that is gone once it has said all."""

    description = "scripted"

    def __init__(self, *frames):
        self.frames = list(frames)
        self.sent = []
        self.is_open = True

    def wait(self, _timeout):
        if not self.frames:
            raise BusError("scripted: the controller is gone")
        return True

    def receive(self, limit):
        taken, self.frames = self.frames[:limit], self.frames[limit:]
        return taken

    def send(self, frames):
        self.sent += frames

    def counters(self):
        return TransportCounters(sent=len(self.sent))

    def close(self):
        self.is_open = False


@pytest.fixture
def run(monkeypatch):
    def run_with(controller, *arguments):
        monkeypatch.setattr("hil_bench.cli.run_setup.open_transport", lambda *_: controller)
        return main(["run", "-i", "virtual", "-c", "x", "--lockstep", *arguments])

    return run_with


def test_it_ends_at_its_duration_of_bench_time(run, capsys):
    controller = Controller(*[SYNC] * 100)
    assert run(controller, "--duration", "0.02", "--sync-period-us", "2000") == 0
    out = capsys.readouterr().out
    assert re.search(r"^lockstep  10 SYNCs of 2000 us: 0\.020 s in \d", out, re.MULTILINE)
    assert not controller.is_open
    assert [frame.can_id for frame in controller.sent] == [0x701, 0x702, 0x703, 0x704]


class Line:
    """A status line that nobody sees."""

    def __init__(self, is_shown):
        self.is_shown = is_shown

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.mark.parametrize("is_shown", [True, False])
def test_a_status_line_is_looked_after_and_without_one_the_log_says_how_far_it_is(
    run, monkeypatch, capsys, is_shown
):
    line, watched = Line(is_shown), []
    monkeypatch.setattr("hil_bench.cli.status_line.StatusLine", lambda *_, **__: line)
    monkeypatch.setattr("hil_bench.cli.status_line.PERIOD", 0)
    watch = RunSetup.watch

    def look_on(setup, *helpers):
        watched.extend(helpers)
        return watch(setup)

    monkeypatch.setattr(RunSetup, "watch", look_on)
    assert run(Controller(*[SYNC] * 20), "--duration", "0.02") == 0
    assert watched == [line] * is_shown
    assert ("hil-bench: 0.020 s: " in capsys.readouterr().err) != is_shown


def test_a_feed_looks_at_each_frame_and_knows_how_many_there_were(run, monkeypatch):
    seen = []

    @contextlib.contextmanager
    def watched(*_, health):
        yield lambda: seen.append(health())

    monkeypatch.setattr("hil_bench.abilities.lockstep.run.watched_run", watched)
    assert run(Controller(*[SYNC] * 3), "--duration", "0.003") == 0
    assert [each["syncs"] for each in seen] == [0, 1, 2, 3]
    assert seen[-1] == {"received": 0, "sent": 4, "syncs": 3}  # the boot-up of four nodes


def test_a_command_acts_with_a_sync(run, monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    # A server that has a command for the loop as soon as the loop looks.
    fields = {"kind": "freeze", "target": "pressure_a", "arguments": {}}

    class Process:
        def __init__(self, _listener, plan):
            plan.down.put(COMMAND, encode({"ticket": 1, "do": "begin_fault", "fields": fields}))

        def look(self):
            return True

        def stop(self):
            pass

    monkeypatch.setattr("hil_bench.abilities.live.view.FeedProcess", Process)
    # Two batches: the loop looks between them, and 64 frames are the most of one.
    assert run(Controller(*[SYNC] * 200), "--duration", "0.2") == 0
    assert re.search(r"0\.\d+ s freeze pressure_a begins", capsys.readouterr().out)


def test_a_lost_bus_ends_it_with_3_and_a_summary(run, capsys):
    assert run(Controller(SYNC)) == 3
    out, err = capsys.readouterr()
    assert "lockstep  1 SYNCs of 1000 us: 0.001 s" in out
    assert err == "hil-bench: error: scripted: the controller is gone\n"


def test_an_interface_that_is_down_at_the_end_is_a_lost_bus(run, capsys):
    controller = Controller(*[SYNC] * 5)
    controller.counters = lambda: TransportCounters(outages=1, is_down=True)
    assert run(controller, "--duration", "0.005") == 3
    out, err = capsys.readouterr()
    assert "lockstep  5 SYNCs of 1000 us: 0.005 s" in out
    assert "1 times the interface went down" in out
    assert err == "hil-bench: error: scripted: the interface was down at the end\n"


def test_the_trace_is_in_bench_time_and_the_same_at_every_run(run, tmp_path):
    traces = []
    for name in ("first.log", "second.log"):
        frames = (START_ALL, SYNC, Frame(0x601, bytes.fromhex("4000100000000000")), SYNC)
        run(Controller(*frames), "--record", str(tmp_path / name), "--duration", "0.002")
        traces.append((tmp_path / name).read_bytes())
    assert traces[0] == traces[1]
    lines = [line.split() for line in traces[0].decode().splitlines()]
    assert lines[:4] == [["(0.000000)", "can0", f"70{n}#00"] for n in (1, 2, 3, 4)]
    assert ["(0.001000)", "can0", "601#4000100000000000"] in lines
    assert lines[-1][0] == "(0.002000)"


@from_text("arguments", "message")
def test_arguments_that_cannot_be_meant(arguments, message, capsys):
    assert main(["run", "-i", "virtual", "-c", "x", *arguments.split()]) == 2
    assert capsys.readouterr().err == f"hil-bench: error: {message}\n"


def test_it_says_join_when_the_nodes_have_booted(run, capsys):
    printed, sent = [], []
    controller = Controller(SYNC)
    send = controller.send

    def note(frames):
        printed.append(capsys.readouterr().out)
        sent.append(list(frames))
        send(frames)

    controller.send = note
    run(controller, "--duration", "0.001")
    assert [frame.can_id for frame in sent[0]] == [0x701, 0x702, 0x703, 0x704]
    assert printed[0] == ""
    assert "".join([*printed, capsys.readouterr().out]).startswith("bench  built-in bench")


# What is shown of a bench in lock-step, on a clock that is moved by hand.


TENTH = 100_000_000  # of a second [ns]


class Bus:
    def counters(self):
        return TransportCounters(received=1234, sent=567)


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def lockstep():
    bench = build_bench(load_config())
    bench.start(0)
    return LockStep(Session(bench), tick_ns=1_000_000)


@pytest.fixture
def status(lockstep, clock):
    return LockStepStatus(lockstep.session.bench, lockstep, Bus(), clock)


def shown(status):
    return format_lines(status.snapshot.read().values, status.lines)


def test_it_tells_how_far_and_how_fast_the_bench_goes(status, lockstep, clock):
    for _ in range(250):
        lockstep.receive(SYNC)
    clock.advance(TENTH)
    status.update()
    axis, progress = shown(status)
    assert axis.startswith("x ")
    assert progress == "0.2 s of bench time  2.5 times real time  in 1234  out 567"
    clock.advance(TENTH)
    status.update()
    assert "0.2 s of bench time  0.0 times real time" in shown(status)[1]


def test_ten_times_a_second_are_enough(status, clock):
    clock.advance(TENTH - 1)
    status.update()
    assert status.snapshot.read() is None
    clock.advance(1)
    status.update()
    assert status.snapshot.read().sequence == 1
