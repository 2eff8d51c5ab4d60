"""The middle of a panel: what it asks a bench for, and what it says when there is none."""

import asyncio
import json

import pytest

from hil_bench.abilities.panel import hub as hub_module
from hil_bench.abilities.panel.bench_link import BenchLink
from hil_bench.abilities.panel.hub import Hub, Viewer
from hil_bench.errors import BusError, WaitTimeoutError


async def send_nowhere(_lines):
    """Take what a browser would."""


class Link:
    """A bench that is asked for things."""

    name = "bench"

    def __init__(self, on_request):
        self.hello = {"fault_targets": {}}
        self.asked = []
        self.on_request = on_request

    async def request(self, action, **fields):
        self.asked.append((action, fields))
        self.on_request(len(self.asked))


def care(hub, link):
    """Let a hub care for a bench until it has nothing more to ask for."""

    async def run():
        task = asyncio.create_task(hub._care(link))
        for _ in range(20):
            await asyncio.sleep(0)
        task.cancel()

    asyncio.run(run())


def test_a_browser_that_comes_while_the_bench_is_asked_gets_rows():
    hub = Hub()
    viewer = Viewer(send_nowhere)
    link = Link(lambda number: hub.admit(viewer) if number == 1 else None)
    care(hub, link)
    assert [fields["rows_every_s"] for _, fields in link.asked] == [None, 0.0]


def test_frames_are_asked_for_where_one_of_several_browsers_shows_them():
    hub, link = Hub(), Link(lambda _number: None)
    viewers = [Viewer(send_nowhere) for _ in range(2)]
    for viewer in viewers:
        hub.admit(viewer)
    viewers[1].wants_marks = True
    care(hub, link)
    assert [fields["frames"] for _, fields in link.asked] == [True]


def test_a_browser_that_comes_later_is_told_what_has_happened():
    hub = Hub()
    hub.link = Link(lambda _number: None)
    for kind in ("event", "command", "rows", "frames"):
        hub._take(kind, f'{{"type":"{kind}"}}\n'.encode(), {})
    viewer = Viewer(send_nowhere)
    hub.admit(viewer)
    kinds = [json.loads(line).get("type") for line in b"".join(viewer._waiting).splitlines()]
    assert kinds[-2:] == ["event", "command"]
    assert not {"rows", "frames"} & {*kinds}


def test_what_a_bench_did_not_hear_is_asked_again(monkeypatch):
    monkeypatch.setattr(hub_module, "RETRY", 0.0)

    def fail_once(number):
        if number == 1:
            raise WaitTimeoutError("no answer in 5 s")

    link = Link(fail_once)
    hub = Hub()
    hub.admit(Viewer(send_nowhere))
    care(hub, link)
    assert [fields["rows_every_s"] for _, fields in link.asked] == [0.0, 0.0]


def test_a_bench_that_does_not_greet_is_given_up():
    async def greet():
        await BenchLink("bench", asyncio.StreamReader(), None, timeout=0.0).greet()

    with pytest.raises(WaitTimeoutError, match="bench bench: no greeting"):
        asyncio.run(greet())


class Ending(Link):
    """A bench that ends at once."""

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        pass

    async def listen(self, _take):
        raise BusError("bench bench has ended")


@pytest.mark.parametrize("error", ["no bench runs", "bench bench: the connection is lost"])
def test_that_a_bench_has_ended_is_said_until_one_runs_again(monkeypatch, error):
    words = []
    links = [Ending(lambda _: None), BusError(error), Ending(lambda _: None)]

    async def open_link(_name):
        words.append(hub._status["words"])
        found = links.pop(0)
        if isinstance(found, BusError):
            raise found
        return found

    monkeypatch.setattr(hub_module, "find_names", lambda: ["bench"])
    monkeypatch.setattr(hub_module, "open_link", open_link)
    monkeypatch.setattr(hub_module, "RETRY", 0.0)
    hub = Hub()
    with pytest.raises(IndexError):
        asyncio.run(hub.run())
    ended = "bench bench has ended; the page goes on when it runs again"
    assert words == ["", ended, ended, ended]
