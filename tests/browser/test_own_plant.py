"""The page of a bench whose plant another distribution brings (examples/plugin)."""

import re

import pytest
from support.distribution import PLUGIN
from support.live_bench import live_bench, panel

from hil_bench import VirtualBench, load_config

expect = pytest.importorskip("playwright.sync_api").expect

pytestmark = pytest.mark.browser


@pytest.fixture
def bench(folder, spring_rig):  # noqa: ARG001 - its sockets and its plant are there
    config = load_config(PLUGIN / "vessel.toml")
    with live_bench(bench=VirtualBench(config, recorded_time=0.01, logged_frames=0)) as bench:
        yield bench


def test_an_own_plant_has_a_table_plots_and_faults(page, bench, keep):
    table = page.get_by_role("table", name="quantities of vessel")
    expect(table.locator("tbody tr")).to_have_text(
        [
            re.compile(r"vessel\.pressure50\.0bar"),
            re.compile(r"vessel\.opening_setpoint0\.0%"),
            re.compile(r"vessel\.opening0\.0%"),
        ]
    )
    machine = page.locator("#view-machine")
    expect(machine.locator("canvas")).to_have_count(2)  # bar, %
    expect(machine.locator(".legend-item")).to_have_count(4)  # with what the sensor measures
    bench.session.bench.axes[0].plant.influence("load_flow", 10e-6)
    expect(table).not_to_contain_text("50.0")  # it falls by 10 bar/s
    page.get_by_role("button", name="Break wire: pressure").click()
    expect(machine.locator(".active-faults")).to_contain_text("break_wire pressure")
    keep(page, "own-plant")


def test_a_kind_that_brings_a_picture_has_it_and_its_plots(pages, folder, spring_rig):  # noqa: ARG001
    config = load_config(PLUGIN / "bench.toml")
    with (
        live_bench(bench=VirtualBench(config, recorded_time=0.01, logged_frames=0)) as bench,
        panel() as port,
    ):
        page = pages.open(port)
        machine = page.locator("#view-machine")
        drawing = machine.locator(".drawing")
        # At rest at 20 mm the spring pulls; nobody commands a force.
        expect(drawing).to_contain_text(re.compile(r"-?\d+\.\d\d mm"))
        expect(drawing).to_contain_text(re.compile(r"force 0\.\d+ k?N"))
        names = [text.split()[0] for text in machine.locator(".legend-item").all_inner_texts()]
        assert {"rig.position", "rig.force_setpoint", "rig.force"} <= set(names)
        assert "rig.speed" not in names
        # The picture has 336 units for the travel of 400 mm: the mass stands where it is.
        page.get_by_role("button", name="Fatigue: rig").click()
        expect(machine.locator(".active-faults")).to_contain_text("fatigue rig")
        moved = drawing.locator("[data-x]")
        bench.session.bench.axes[0].plant.go_to({"position": -0.2, "speed": 0.0})
        expect(moved).to_have_attribute("transform", re.compile(r"translate\((4[89]|5\d)\.\d+ 0\)"))
