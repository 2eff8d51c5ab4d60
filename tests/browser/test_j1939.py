"""The page of a bench with J1939 devices."""

from pathlib import Path

import pytest
from support.live_bench import live_bench, panel

from hil_bench import VirtualBench, load_config
from hil_bench.bench.peers import peers_of

expect = pytest.importorskip("playwright.sync_api").expect

pytestmark = pytest.mark.browser

BENCH = Path(__file__).parents[2] / "examples" / "j1939_lever.toml"


@pytest.fixture
def bench(folder):  # noqa: ARG001 - its sockets are there
    virtual = VirtualBench(load_config(BENCH), recorded_time=0.01, logged_frames=0)
    with live_bench(bench=virtual) as bench:
        yield bench


@pytest.fixture
def page(pages, bench, tmp_path):  # noqa: ARG001 - what it shows
    with panel(folder=tmp_path) as port:
        page = pages.open(port)
        yield page
        assert pages.complaints == []


def test_a_lever_is_moved_and_broken_from_the_page(page, bench):
    page.locator("#tab-devices").click()
    card = page.locator("#view-devices article", has_text="joystick")
    expect(card).to_contain_text("Address claim: 19")
    expect(card.locator('[aria-current="true"]')).to_have_text("claimed")
    card.get_by_label("new value of joystick.x", exact=True).fill("400")
    card.get_by_role("button", name="set joystick.x", exact=True).click()
    expect(card.get_by_role("alert")).to_contain_text("give -100.3 to 100.3 %")
    card.get_by_label("new value of joystick.x", exact=True).fill("-42")
    card.get_by_role("button", name="set joystick.x", exact=True).click()
    expect(card).to_contain_text("-42 %")
    assert peers_of(bench.session.bench)["joystick"]["x_left"] == 1.0

    page.locator("#tab-faults").click()
    faults = page.locator("#view-faults")
    faults.get_by_role("button", name="Show error indicator", exact=True).click()
    faults.get_by_role("button", name="Begin the fault").click()
    expect(faults).to_contain_text("indicate joystick.x has begun")
    page.locator("#tab-devices").click()
    expect(card).to_contain_text("SPN 2660 FMI 2")
    expect(card).to_contain_text("no value")


def test_frames_are_named_by_device_and_group(page):
    page.locator("#tab-bus").click()
    senders = page.locator("#view-bus").get_by_role("region", name="who sends what")
    expect(senders).to_contain_text("joystick PGN 64982")
    expect(senders).to_contain_text("valve PGN 65040")


def test_an_axis_of_a_j1939_valve_has_its_valve_and_lines(page):
    page.locator("#tab-machine").click()
    drawing = page.locator("#view-machine .drawing")
    expect(drawing.get_by_role("button", name="valve", exact=True)).to_be_visible()
    assert drawing.locator("path.pipe").count() >= 2
