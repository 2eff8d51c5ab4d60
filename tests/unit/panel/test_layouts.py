"""Layouts of the page: what is taken of a file, and what is refused in a line."""

import math
from pathlib import Path

import pytest

from hil_bench.abilities.panel.layouts import (
    check_layout,
    list_layouts,
    path_of,
    read_layout,
    write_layout,
)
from hil_bench.bench.configuration import load_config
from hil_bench.errors import ConfigError
from hil_bench.session.virtual_bench import VirtualBench

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
