"""The page of an axis whose supply unit cannot hold the pressure that it is set to."""

import re

import pytest
from support.live_bench import live_bench

from hil_bench import Faults, VirtualBench, load_config

expect = pytest.importorskip("playwright.sync_api").expect

pytestmark = pytest.mark.browser

UNIT = """
[plant.axis1]
supply = "unit"
supply_pressure_bar = 210
relief_pressure_bar = 210
pump_flow_l_min = 0.001
"""


@pytest.fixture
def bench(folder, tmp_path):  # noqa: ARG001 - its sockets are there
    path = tmp_path / "bench.toml"
    path.write_text(UNIT)
    bench = VirtualBench(load_config(path), recorded_time=0.01, logged_frames=0)
    with live_bench(bench=bench) as bench:
        yield bench


def test_the_pressure_of_an_own_unit_is_that_of_the_plant(page, bench, keep):
    drawing = page.locator(".drawing")
    expect(page.locator(".pressure-legend")).to_contain_text("210.0 bar")
    expect(drawing).to_contain_text(re.compile(r"P \d+\.\d bar"))
    # Held at 31.9 bar by a fault, while 210 bar are set; this pump lifts it by nothing in a tick.
    bench.session.bench.part(Faults).drop_supply("axis1", 31.9e5)
    expect(drawing).to_contain_text("P 31.9 bar")
    legend = page.locator("#view-machine .legend-item", has_text="axis1.P_S")
    expect(legend).to_contain_text("31.9")
    keep(page, "supply-unit")
