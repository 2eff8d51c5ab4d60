"""The page of a bench whose plant another distribution brings (examples/plugin)."""

import re

import pytest
from support.distribution import PLUGIN
from support.live_bench import live_bench

from hil_bench.bench.configuration import load_config
from hil_bench.session.virtual_bench import VirtualBench

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
