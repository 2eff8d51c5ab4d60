"""`hil-bench panel`, `run --panel`, and the new words of `ctl`."""

import signal
import subprocess
import sys

import pytest
import uvicorn
from support.feed_loop import FeedLoop

from hil_bench.abilities.common.commands import Stop
from hil_bench.abilities.live import ctl, places, view
from hil_bench.abilities.panel import server
from hil_bench.bench.session import Session
from hil_bench.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


class Panel:
    """A panel that ends, or does not, as a test wants it."""

    def __init__(self, ends_after):
        self.calls, self._ends_after = [], ends_after

    def start(self, command, **_options):
        self.command = command
        return self

    def wait(self, timeout=None):
        self.calls.append("wait")
        if timeout is not None and len(self.calls) < self._ends_after:
            raise subprocess.TimeoutExpired("panel", timeout)

    def terminate(self):
        self.calls.append("terminate")

    def kill(self):
        self.calls.append("kill")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("ends_after", "calls"),
    [
        (1, ["wait"]),
        (3, ["wait", "terminate", "wait"]),
        (9, ["wait", "terminate", "wait", "kill", "wait"]),
    ],
)
def test_a_run_has_its_panel_end_with_it(ends_after, calls, monkeypatch):
    panel = Panel(ends_after)
    monkeypatch.setattr(view.subprocess, "Popen", panel.start)
    words = ["-i", "virtual", "-c", "x", "--speed", "max", "--duration", "0.01", "--panel"]
    assert main(["run", *words, "--name", "left"]) == 0
    words = ["-m", "hil_bench", "panel", "--bench", "left", "--once"]
    assert panel.command == [sys.executable, *words]
    assert panel.calls == calls


def test_a_panel_needs_a_feed(cli):
    words = ["-i", "virtual", "-c", "x", "--panel", "--no-feed"]
    assert "--panel: needs the feed, which is off (--no-feed)" in (cli(["run", *words], 2).err)


def test_a_panel_needs_its_extra(monkeypatch, cli):
    monkeypatch.setattr(places.importlib.util, "find_spec", lambda _name: None)
    assert "pip install 'hil-bench[panel]'" in cli("run -i virtual -c x --panel", 2).err
    monkeypatch.setitem(sys.modules, "hil_bench.abilities.panel.server", None)
    assert "pip install 'hil-bench[panel]'" in cli("panel", 2).err


def test_the_address_is_printed_with_its_secret(monkeypatch, cli):
    plans = []

    async def serve(plan, _listener, secret, _stopped):
        plans.append((plan, secret))

    monkeypatch.setattr(server, "_serve", serve)
    monkeypatch.setattr("hil_bench.abilities.panel.verbs.os.nice", lambda _by: 0)
    word, address = cli("panel --port 0 --bench left").out.split()
    place, _, token = address.partition("/#")
    assert word == "panel"
    assert place.startswith("http://127.0.0.1:")
    ((plan, secret),) = plans
    assert secret.fits(token)
    assert len(token) >= 22  # 128 bits in base64
    assert plan.bench == "left"


@pytest.mark.usefixtures("signals_that_are_heard")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_page_in_order(number, monkeypatch, cli):
    """Its server hears SIGINT and SIGTERM by itself, and ends its process by them again."""
    served = uvicorn.Server.startup

    async def starting(server, sockets=None):
        await served(server, sockets)
        signal.raise_signal(number)

    monkeypatch.setattr(uvicorn.Server, "startup", starting)
    monkeypatch.setattr("hil_bench.abilities.panel.verbs.os.nice", lambda _by: 0)
    assert cli("panel --port 0 --bench none").out.startswith("panel  http://127.0.0.1:")


def test_with_a_password_the_address_has_no_secret(make_file, monkeypatch, cli):
    secrets = []

    async def serve(_plan, _listener, secret, _stopped):
        secrets.append(secret)

    monkeypatch.setattr(server, "_serve", serve)
    monkeypatch.setattr("hil_bench.abilities.panel.verbs.os.nice", lambda _by: 0)
    path = make_file("password", "correct horse battery")
    path.chmod(0o600)
    assert cli(["panel", "--port", "0", "--password-file", str(path)]).out.strip().endswith("/")
    assert secrets[0].fits("correct horse battery")


@pytest.mark.usefixtures("folder")
def test_a_stop_at_the_door_ends_a_run_in_order(monkeypatch, capsys):
    tick = Session.tick

    def stop_at_5_ms(session, frames, now, send=None):
        if now == 5_000_000:
            session.door.put(Stop())
        return tick(session, frames, now, send)

    monkeypatch.setattr(Session, "tick", stop_at_5_ms)
    assert main(["run", "-i", "virtual", "-c", "x", "--speed", "max", "--duration", "1"]) == 0
    # Ticks at 0 to 5 ms.
    assert "ticks     6 of 1000 us" in capsys.readouterr().out


def test_marks_and_the_end_come_from_the_shell(monkeypatch, cli):
    loop = FeedLoop()
    monkeypatch.setattr(ctl, "connect", loop.connect)
    assert main(["ctl", "mark", "pulled\x1b here"]) == 0
    assert cli("ctl stop").out == "marked: pulled\\x1b here\nthe bench ends\n"
    assert loop.session.controls.is_over
    assert [entry["do"] for entry in loop.session.controls.journal.content()["entries"]] == ["mark"]
