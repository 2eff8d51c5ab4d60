"""Layouts: opened from a file, edited by keys, kept; and those that do not fit."""

import re
from pathlib import Path

import pytest
from support.axe import serious_problems
from support.live_bench import live_bench, panel

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.panel.layouts import read_layout

expect = pytest.importorskip("playwright.sync_api").expect

pytestmark = pytest.mark.browser

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def bench(folder):  # noqa: ARG001 - its sockets are there
    config = load_config(EXAMPLES / "two_axes.toml")
    with live_bench(bench=VirtualBench(config, recorded_time=0.01, logged_frames=0)) as bench:
        yield bench


@pytest.mark.usefixtures("bench")
def test_the_layout_of_an_example_opens_and_acts(pages, keep):
    with panel(layout=EXAMPLES / "two_axes.layout.toml") as port:
        page = pages.open(port)
        view = page.locator("#view-layout")
        expect(view).to_be_visible()
        expect(view.locator(".cell")).to_have_count(9)
        expect(view.get_by_role("alert")).to_have_text("")
        expect(view.locator(".cell-value .figure")).to_have_text(re.compile(r"^0\.0 mm/s$"))
        keep(page, "layout")
        view.get_by_role("button", name="Cut the press's sensor").click()
        expect(view.get_by_role("button", name="Cut the press's sensor")).to_have_attribute(
            "aria-pressed", "true"
        )
        slider = view.get_by_label("press: load [kN]")
        slider.focus()
        slider.press("End")
        expect(view.locator(".cell-slider .figure")).to_have_text("100.000 kN")
        assert serious_problems(page) == []


def test_a_layout_is_made_by_keys_kept_and_read_again(pages, folder, tmp_path, keep):  # noqa: ARG001
    hello = {"bench_file": str(tmp_path / "bench.toml")}
    with live_bench(hello=hello), panel() as port:
        page = pages.open(port)
        page.locator("#tab-layout").click()
        view = page.locator("#view-layout")
        expect(view.locator(".cell")).to_have_count(2)  # machine and plots, by default
        expect(view.locator(".cell .problem")).to_have_count(0)
        expect(view.locator(".cell canvas")).to_have_count(3)  # of a plant without its own P_S
        view.get_by_role("button", name="Edit").click()
        view.get_by_label("kind of item").select_option("value")
        view.get_by_label("what it shows").select_option("axis1.speed")
        view.get_by_role("button", name="Add").click()
        grip = view.get_by_role("button", name=re.compile("^value: arrows"))
        grip.focus()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Shift+ArrowRight")
        expect(grip).to_be_focused()
        keep(page, "layout-edited")
        view.get_by_label("name of the layout").fill("../out")
        view.get_by_role("button", name="Save").click()
        expect(view.get_by_role("alert")).to_contain_text("give up to 61 letters")
        view.get_by_label("name of the layout").fill("mine")
        view.get_by_role("button", name="Save").click()
        expect(view.get_by_role("status")).to_contain_text("mine.layout.toml")
        (item,) = [
            each
            for each in read_layout(tmp_path / "mine.layout.toml")["items"]
            if each["kind"] == "value"
        ]
        assert (item["column"], item["width"], item["channel"]) == (2, 4, "axis1.speed")


def test_a_layout_of_another_bench_says_what_is_missing(pages, folder, tmp_path):  # noqa: ARG001
    path = tmp_path / "odd.layout.toml"
    path.write_text(
        'bench = "<b>other</b>.toml"\n'
        '[[items]]\nkind = "value"\ncolumn = 1\nrow = 1\nwidth = 6\nheight = 2\n'
        'channel = "<img src=x onerror=alert(1)>"\n'
        '[[items]]\nkind = "value"\ncolumn = 7\nrow = 1\nwidth = 6\nheight = 2\n'
        'channel = "axis1.position"\n'
    )
    hello = {"bench_file": str(tmp_path / "bench.toml")}
    with live_bench(hello=hello), panel(layout=path) as port:
        page = pages.open(port)
        view = page.locator("#view-layout")
        expect(view.get_by_role("alert")).to_contain_text(
            "is a layout of <b>other</b>.toml; this bench is bench.toml"
        )
        expect(view.locator(".cell").first).to_have_text(
            "<img src=x onerror=alert(1)>: this bench has no such channel"
        )
        expect(view.locator(".cell-value .item-value")).to_have_text("0.00 mm")
        assert view.locator("img").count() == 0
