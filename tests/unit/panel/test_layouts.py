"""Layouts of the page: what is taken of a file, and what is refused in a line."""

import errno
import math
import os
from pathlib import Path

import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.panel.layouts import (
    check_layout,
    list_layouts,
    path_of,
    read_layout,
    write_layout,
)
from hil_bench.errors import ConfigError, DiskError

EXAMPLES = Path(__file__).parents[3] / "examples"
PLACE = {"column": 1, "row": 1, "width": 6, "height": 2}


def item(kind, **keys):
    return {"kind": kind, **PLACE, **keys}


def check(*items, **keys):
    return check_layout({"items": list(items), **keys}, "x.layout.toml")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (item("plot", channels=[]), "item 1: channels: give a list of 1 to 16 names"),
        (item("plot", channels=["a", ""]), "channels: give a list of 1 to 16"),
        (item("plot", channels=["a"] * 17), "channels: give a list of 1 to 16"),
        (item("plot", channels=["a"], seconds=math.nan), "seconds: give 0.1 to 120"),
        (item("plto"), "kind 'plto': give one of bus, button"),
        (item("plot", channel_s=["a"]), "key 'channel_s' is not known; did you mean channels?"),
        (item("value"), "channel: give a name"),
        (item("value", channel="a\x1b[31m"), "channel: give a name"),
        (item("gauge", channel="a", low_si=1.0, high_si=1.0), "low_si: give less than high_si"),
        (item("gauge", channel="a", low_si=-math.inf, high_si=1.0), "low_si: give a finite number"),
        ({**item("text", text="x"), "column": 8}, "ends beyond column 12"),
        ({**item("text", text="x"), "row": True}, "row: give 1 to 200"),
        ({**item("text", text="x"), "height": 41}, "height: give 1 to 40"),
        (item("button", text="x", fault="f", target="t", keys={"a": []}), "keys: give a table"),
        ("x", "item 1: give a table"),
    ],
)
def test_a_wrong_item_is_a_line(wrong, words):
    with pytest.raises(ConfigError) as caught:
        check(wrong)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# docs/watching.md: the kinds of items with their keys; those of OPTIONAL may be left out.
KINDS = {
    "bus": {},
    "button": {"text": "t", "fault": "f", "target": "t", "keys": {"a": 1.5, "b": "c"}},
    "gauge": {"channel": "c", "low_si": -1, "high_si": 1.5},
    "machine": {"axis": "a"},
    "plot": {"channels": ["c"] * 16, "seconds": 0.1},
    "slider": {"axis": "a", "quantity": "q", "low_si": 0.0, "high_si": 1e299},
    "text": {"text": "x" * 400},
    "value": {"channel": "c"},
    "verdicts": {},
}
OPTIONAL = {"keys", "seconds"}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_its_keys_and_needs_all_but_the_optional_ones(kind):
    whole = item(kind, **KINDS[kind])
    assert check(whole)["items"] == [whole]
    for key in (*PLACE, *KINDS[kind]):
        part = {each: value for each, value in whole.items() if each != key}
        if key in OPTIONAL:
            assert check(part)["items"] == [part]
        else:
            with pytest.raises(ConfigError, match=rf"item 1: {key}: give "):
                check(part)


def test_a_layout_at_each_limit_is_taken():
    last = {"kind": "bus", "column": 12, "row": 200, "width": 1, "height": 40}
    wide = {"kind": "bus", "column": 1, "row": 1, "width": 12, "height": 1}
    items = [last, wide, item("plot", channels=["c"], seconds=120), *[item("bus")] * 61]
    found = check(*items, title="x" * 400, bench="")
    assert found == {"title": "x" * 400, "bench": "", "items": items}
    assert check() == {"title": "", "bench": "", "items": []}
    for key in PLACE:
        for value in (0, last[key] + 1 if key != "width" else 13):
            with pytest.raises(ConfigError, match=rf"{key}: give 1 to "):
                check({**last, key: value})
    for seconds in (0.09, 121):
        with pytest.raises(ConfigError, match=r"give 0\.1 to 120$"):
            check(item("plot", channels=["c"], seconds=seconds))
    for number in (True, 1e300, "1"):
        with pytest.raises(ConfigError, match="high_si: give a finite number"):
            check(item("gauge", channel="c", low_si=0, high_si=number))


def test_too_much_is_refused():
    with pytest.raises(ConfigError, match="at most 64"):
        check(*[item("bus")] * 65)
    with pytest.raises(ConfigError, match="title: give a text"):
        check(title="x" * 401)
    with pytest.raises(ConfigError, match="key 'colour' is not known"):
        check(colour="red")


@pytest.mark.parametrize("name", ["", "..", "a/b", "../x", "-x", "a" * 62, "a\n", "a.b"])
def test_no_name_leaves_the_folder(name, tmp_path):
    with pytest.raises(ConfigError, match="give up to 61 letters"):
        path_of(name, tmp_path)


def test_what_is_written_is_read_back(tmp_path):
    layout = check(
        item("plot", channels=['a "b" \\ c', "ü.ß"], seconds=5),
        item("gauge", channel="a", low_si=-1e-7, high_si=2.5e7),
        item(
            "button", text="cut", fault="offset", target="p", keys={"offset_bar": 20.5, "path": "a"}
        ),
        title="<b>day</b>",
        bench="bench.toml",
    )
    path = path_of("day", tmp_path)
    write_layout(layout, path, replaces=False)
    assert read_layout(path) == layout
    assert list_layouts(tmp_path) == ["day"]
    with pytest.raises(ConfigError, match="is there already"):
        write_layout(layout, path, replaces=False)
    write_layout({**layout, "title": ""}, path, replaces=True)
    assert read_layout(path)["title"] == ""
    with pytest.raises(ConfigError, match=r"day\.layout\.toml: there is no folder .*x; make"):
        write_layout(layout, tmp_path / "x" / path.name, replaces=False)
    for number in range(150):
        (tmp_path / f"{number:03}.layout.toml").touch()
    (tmp_path / "other.toml").touch()
    assert list_layouts(tmp_path) == [f"{number:03}" for number in range(100)]


def test_a_full_disk_leaves_the_layout_that_was_there(tmp_path, monkeypatch):
    path = path_of("day", tmp_path)
    write_layout(check(title="old"), path, replaces=False)

    def fill(file, text, encoding):
        with file.open("w", encoding=encoding) as opened:
            opened.write(text[:5])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", fill)
    with pytest.raises(DiskError, match="cannot be written: No space left on device"):
        write_layout(check(title="new"), path, replaces=True)
    assert read_layout(path)["title"] == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "path", sorted(EXAMPLES.rglob("*.layout.toml")), ids=lambda each: each.name
)
def test_the_layouts_of_examples_name_what_their_benches_have(path):
    layout = read_layout(path)
    config = load_config(path.with_name(layout["bench"]))
    bench = VirtualBench(config, logged_frames=0)
    channels = {channel.name for channel in bench.session.channels}
    axes = {axis.name: {each.name for each in axis.influences} for axis in config.axes}
    for each in layout["items"]:
        assert set(each.get("channels", [])) <= channels
        assert {each[key] for key in ("channel",) if key in each} <= channels
        if "axis" in each:
            assert each["axis"] in axes
        if "quantity" in each:
            assert each["quantity"] in axes[each["axis"]]
    bench.close()


def test_a_folder_that_is_not_there_has_no_layouts(tmp_path):
    assert list_layouts(tmp_path / "nowhere") == []
