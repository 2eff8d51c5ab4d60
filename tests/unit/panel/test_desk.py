"""The desk of a panel: layouts where the bench's file is, and seats that are given back."""

import asyncio
import json
from types import SimpleNamespace

import pytest

from hil_bench.abilities.panel.desk import Desk
from hil_bench.abilities.panel.hub import Hub, Viewer
from hil_bench.errors import BusError

LAYOUT = {"title": "day", "bench": "", "items": []}


@pytest.fixture
def ask(tmp_path):
    """Ask a desk, of a bench with a file or without, for something; return its answer."""

    def ask(action, *, bench_file=None, opened=None, **fields):
        hub = SimpleNamespace(bench=SimpleNamespace(hello={"bench_file": bench_file}))
        (tmp_path / "tests").mkdir(exist_ok=True)
        desk = Desk(hub, tmp_path / "tests", opened)
        request = json.dumps({"id": 7, "do": action, **fields})
        answer = json.loads(asyncio.run(desk.answer(None, request)))
        assert answer["id"] == 7
        return answer.get("value", answer.get("error"))

    return ask


@pytest.mark.parametrize(("file", "folder"), [(None, "tests"), ("benches/bench.toml", "benches")])
def test_layouts_are_beside_the_file_of_the_bench_or_with_the_tests(ask, tmp_path, file, folder):
    (tmp_path / folder).mkdir(exist_ok=True)
    bench = {"bench_file": file and str(tmp_path / file)}
    path = tmp_path / folder / "day.layout.toml"
    save = {"name": "day", "layout": LAYOUT, **bench}
    assert ask("save_layout", replaces=False, **save) == {"path": str(path)}
    assert "is there already" in ask("save_layout", replaces=False, **save)
    assert ask("save_layout", replaces=True, **save) == {"path": str(path)}
    name = file and file.rpartition("/")[2]
    assert ask("layouts", **bench) == {"names": ["day"], "bench": name or "", "first": None}
    assert ask("layout", name="day", **bench) == LAYOUT
    first = ask("layouts", opened=path, **bench)["first"]
    assert first == {"path": str(path), "layout": LAYOUT}
    wrong = {"name": "day", "layout": {"colour": ""}, "replaces": True, **bench}
    assert ask("save_layout", **wrong).startswith("the layout: key 'colour' is not known; ")


def test_a_seat_is_free_again_when_its_browser_has_left():
    async def nowhere(_lines):
        pass

    hub = Hub(seats=1)
    first, second = Viewer(nowhere), Viewer(nowhere)
    hub.admit(first)
    with pytest.raises(BusError, match="1 browsers look at this panel already; close one"):
        hub.admit(second)
    hub.leave(first)
    hub.leave(first)  # a second time does nothing
    hub.admit(second)
    assert hub.viewers == [second]
