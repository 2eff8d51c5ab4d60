"""A panel that ends with its bench, and a bench that was killed before the panel was there."""

import asyncio

import pytest

from hil_bench.abilities.panel import hub
from hil_bench.errors import BusError


class EnoughError(Exception):
    """Ends a panel that would go on."""


@pytest.fixture
def running(monkeypatch):
    """Return a list to be filled: which benches run, look by look; nobody answers in any."""
    looks = []

    def find_names():
        if not looks:
            raise EnoughError
        return looks.pop(0)

    async def open_link(name):
        raise BusError(f"bench {name}: the connection is lost")

    monkeypatch.setattr(hub, "find_names", find_names)
    monkeypatch.setattr(hub, "open_link", open_link)
    monkeypatch.setattr(hub, "RETRY", 0.0)
    return looks


@pytest.mark.parametrize("looks", [[[]], [["left"], ["left"], ["other"]]])
def test_a_bench_that_is_gone_before_it_was_seen_ends_the_panel(running, looks):
    running += looks
    with pytest.raises(BusError, match="bench left does not run; the panel ends with it"):
        asyncio.run(hub.Hub("left").run(is_once=True))
    assert running == []


@pytest.mark.parametrize(("name", "is_once"), [(None, True), ("left", False)])
def test_other_panels_wait_for_a_bench(running, name, is_once):
    running += [[]] * 5
    with pytest.raises(EnoughError):
        asyncio.run(hub.Hub(name).run(is_once=is_once))
