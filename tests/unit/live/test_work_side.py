"""What people see of `commission`, `shadow`, `test` and `campaign` while they run."""

import contextlib
import signal
import threading

import pytest
from support.campaigns import write_rest
from support.live_bench import runtime_folder
from support.patience import GUARD

from hil_bench.abilities.campaign.verbs import campaign
from hil_bench.abilities.commissioning.verbs import commission
from hil_bench.abilities.common.work import ShownRows, WorkView
from hil_bench.abilities.live import view as live_view
from hil_bench.abilities.live.client import connect
from hil_bench.abilities.live.places import Place, find_names
from hil_bench.abilities.scenario.verbs import test as test_verb
from hil_bench.cli import main


class Seen(WorkView):
    """Keeps all that was shown."""

    is_watched = True

    def __init__(self):
        super().__init__()
        self.states, self.rows, self.opened = [], [], None

    def show(self, **changes):
        super().show(**changes)
        self.states.append(self.state)

    def put_row(self, values):
        self.rows.append(values)

    @contextlib.contextmanager
    def open(self, _args, verb, title, channels=(), **_more):
        self.opened = verb, title, [channel.name for channel in channels]
        yield self


def seen_by(module, monkeypatch):
    seen = Seen()
    monkeypatch.setattr(module, "watched_work", seen.open)
    return seen


PLAN = """\
[plan]
period_ms = 2
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
time_s = 60
[communication]
[sensors]
"""


@pytest.mark.long
def test_a_commissioning_shows_its_step_its_limits_and_its_values(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PLAN)
    monkeypatch.setattr(commission, "hold_to_real_time", lambda _session: None)
    seen = seen_by(commission, monkeypatch)
    assert main(["commission", "plan.toml", "--virtual", "--output", "out", "--quiet"]) == 0
    verb, title, channels = seen.opened
    assert (verb, title) == ("commission", "plan.toml on virtual bench")
    sensors = next(state for state in seen.states if state.now == "sensors")
    assert sensors.detail.startswith("position -150 to 150 mm, speed to 400 mm/s")
    # The plan's limits in SI: 1 bar is 1e5 Pa.
    assert sensors.limits["axis1.P_A"] == pytest.approx((-1e5, 110e5))
    assert sensors.limits["axis1.speed"] == pytest.approx((-0.4, 0.4))
    assert set(sensors.limits) <= set(channels)
    assert [item.verdict for item in sensors.items] == ["passed", "runs"]
    last = seen.states[-1]
    assert (last.done, last.total, last.verdict) == (2, 2, "passed")
    assert {len(row) for row in seen.rows} == {1 + len(channels)}
    assert [row[0] for row in seen.rows] == sorted(row[0] for row in seen.rows)


@pytest.mark.long
def test_a_campaign_shows_verdicts_and_the_worst_margins(tmp_path, monkeypatch):
    seen = seen_by(campaign, monkeypatch)
    words = [str(write_rest(tmp_path)), "--runs", "4", "--sampler", "grid", "--quiet"]
    main(["campaign", *words, "--output", str(tmp_path / "out")])
    last = seen.states[-1]
    assert last.done == last.total == 25  # five levels of two parameters
    assert sum(last.counts.values()) == last.total
    # P_A at rest is near 50 bar: a limit of 1 bar is among the grid's, so R-1 fails somewhere.
    assert last.counts["failed"] > 0
    assert [item.name.split()[-1] for item in last.items] == ["R-1", "R-2"]
    worst = last.items[0]
    assert worst.verdict == "failed"
    assert worst.text.startswith("smallest margin -")
    assert "limit_bar = 1" in worst.text.replace("=", " = ").replace("  ", " ")
    again = seen_by(campaign, monkeypatch)
    main(["campaign", *words, "--output", str(tmp_path / "out")])
    assert again.states[-1].counts == {"done before": last.total}


def test_tests_show_which_one_runs_and_what_failed_first(tmp_path, monkeypatch):
    seen = seen_by(test_verb, monkeypatch)
    path = write_rest(tmp_path)
    assert main(["test", str(path), "--set", "limit_bar=1", "--quiet"]) == 1
    assert seen.states[0].now == str(path)
    last = seen.states[-1]
    assert [(item.name, item.verdict) for item in last.items] == [
        ("rest.scenario.toml R-1", "failed"),
        ("rest.scenario.toml R-2", "passed"),
    ]
    assert (last.now, last.done, last.total, last.verdict) == ("", 1, 1, "failed")


def test_rows_go_to_the_recording_too():
    seen, rows = Seen(), []

    class Recording:
        def append_row(self, values):
            rows.append(values)

    ShownRows(Recording(), seen).append_row((0.0, 1.0))
    ShownRows(None, seen).append_row((0.1, 1.0))
    assert rows == [(0.0, 1.0)]
    assert seen.rows == [(0.0, 1.0), (0.1, 1.0)]


class Words:
    """A command line."""

    panel, name = False, "mine"


@pytest.fixture
def folder(monkeypatch):
    with runtime_folder(monkeypatch) as folder:
        yield folder


@pytest.fixture
def _interruptible():
    """SIGINT as a terminal has it: a shell without job control starts programs that ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("folder", "_interruptible")
def test_a_stop_from_outside_is_a_ctrl_c_wherever_the_work_waits():

    def stop():
        with connect("mine", timeout=GUARD) as client:
            assert client.hello["work"] == {"verb": "shadow", "title": "bench.toml", "again": []}
            client.request("stop")

    watcher = threading.Thread(target=stop)

    def work():
        with live_view.watched_work(Words(), "shadow", "bench.toml"):
            watcher.start()
            threading.Event().wait(GUARD)

    with pytest.raises(KeyboardInterrupt):
        work()
    watcher.join()
    assert find_names() == []


@pytest.mark.usefixtures("folder")
def test_without_a_wish_nobody_can_watch():
    args = Words()
    args.name = None
    with live_view.watched_work(args, "shadow", "bench.toml") as view:
        assert not view.is_watched
        assert find_names() == []
        view.show(now="nothing")
        view.put_row((0.0,))


@pytest.mark.usefixtures("folder")
def test_a_name_that_is_taken_is_refused(capsys, tmp_path):
    place = Place("mine")
    assert main(["test", str(write_rest(tmp_path)), "--name", "mine"]) == 2
    assert 'a bench with the name "mine" runs already' in capsys.readouterr().err
    place.release()
