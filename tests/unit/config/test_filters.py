"""The filter of a supply from its data sheet to the bench, and how it clogs."""

import json

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench, load_config

SHARED = """
[supply.hpu]
pump_flow_l_min = 30
relief_pressure_bar = 100
relief_gradient_l_min_bar = 30
accumulator_volume_l = 0
supply_pressure_bar = 101
oil_viscosity_mm2_s = 60
filter_rated_flow_l_min = 60
filter_rated_drop_bar = 2
filter_bypass_bar = 6

[plant.lift]
supply = "hpu"

[plant.clamp]
supply = "hpu"
orifice_width_mm = 10

[nodes]
lift_valve = { profile = "valve_408", axis = "lift", node_id = 1 }
clamp_valve = { profile = "valve_408", axis = "clamp", node_id = 2 }
[nodes.indicator]
profile = "pressure_404"
axis = "lift"
source = "filter_drop"
span_bar = [0, 10]
node_id = 3
"""
RESISTANCE = 2e5 / 1e-3 * (60.0 / 30.0)
"""2 bar at 60 l/min and 30 mm²/s, in an oil of 60 mm²/s [Pa s/m³]."""


@pytest.fixture
def write(tmp_path):
    def write(old="", new="", text=SHARED):
        path = tmp_path / "bench.toml"
        path.write_text(text.replace(old, new, 1) if old else text)
        return path

    return write


def run_out(bench):
    """Open the first axis a little, until its motion is steady; return its signals."""
    for axis in bench.bench.axes[:1]:
        axis.command_path.add(lambda _u, full=axis.valve.full_opening: 0.4 * full)
    bench.run(0.8)
    return bench.signals


def test_the_drop_of_a_shared_supply_is_measured_and_lacks_in_motion(write):
    with VirtualBench(load_config(write())) as bench:
        signals = run_out(bench)
        Q, drop = signals["lift.Q_S"][-1], signals["lift.filter_drop"][-1]
        assert drop == pytest.approx(RESISTANCE * Q, rel=1e-3)
        shown = signals["indicator.measured"][-1]
        assert shown == drop
        # P_R + (Q_P - Q) / G - R Q with 30 l/min and 30 l/min a bar
        expected = 100e5 + (5e-4 - Q) / (5e-4 / 1e5) - drop
        assert signals["lift.P_S"][-1] == pytest.approx(expected, rel=1e-4)


def test_dirt_opens_the_bypass_and_a_new_element_closes_it(write):
    with VirtualBench(load_config(write())) as bench:
        run_out(bench)
        fault = bench.faults.clog_filter("hpu", 0.99, growth=0.2)
        bench.run(0.1)
        half, Q = (bench.signals[f"lift.{name}"][-1] for name in ("filter_drop", "Q_S"))
        blocked = 0.99 * 99 / 200  # it begins with 0 in the first of the ticks
        assert half == pytest.approx(RESISTANCE / (1.0 - blocked) * Q, rel=1e-3)
        bench.run(0.3)
        assert bench.signals["lift.filter_drop"][-1] == 6e5
        fault.clear()
        bench.run(0.2)
        mended, Q = (bench.signals[f"lift.{name}"][-1] for name in ("filter_drop", "Q_S"))
        assert mended == pytest.approx(RESISTANCE * Q, rel=1e-3)


def test_axes_without_motion_do_not_notice_a_clogged_filter(write):
    with VirtualBench(load_config(write())) as bench:
        bench.faults.clog_filter("hpu", 1.0)
        bench.run(0.3)
        assert bench.signals["clamp.P_S"][-1] == pytest.approx(101e5, rel=1e-4)


def test_an_axis_with_a_unit_of_its_own_has_one_too(write):
    own = """
[plant.axis1]
supply = "unit"
accumulator_volume_l = 0
oil = "HLP 46"
filter_rated_flow_l_min = 30
filter_rated_drop_bar = 1
"""
    with VirtualBench(load_config(write(text=own))) as bench:
        bench.faults.clog_filter("axis1", 0.9)
        run_out(bench)
        plant = bench.bench.axes[0].plant.model
        Q = plant.output.Q_A
        drop = 10.0 * 1e5 / 5e-4 * 46.0 / 30.0 * Q
        # 60 l/min over 12 l/min a bar
        expected = 100e5 + (1e-3 - Q) / 2e-9 - drop
        assert plant.supply_pressure == pytest.approx(expected, rel=1e-4)
        shown = [bench.signals[f"axis1.{name}"][-1] for name in ("P_S", "Q_S", "filter_drop")]
        assert shown[0] == plant.supply_pressure
        assert shown[1:] == pytest.approx([Q, drop], rel=1e-4)


def test_the_oil_of_a_shared_supply_says_its_viscosity(write):
    path = write("oil_viscosity_mm2_s = 60", 'oil = "HLP 46"\nstart_temperature_c = 100')
    (supply,) = load_config(path).supplies
    # 6.8 mm²/s at 100 °C
    assert supply.unit.filter.resistance == pytest.approx(2e5 / 1e-3 * 6.8 / 30.0)


def test_check_says_the_drop(write, cli):
    facts = json.loads(cli(["check", "--json", str(write())]).out)["summary"]["hpu"]
    (drop,) = [fact["value"] for fact in facts if fact["name"] == "drop of the filter"]
    assert drop == pytest.approx(RESISTANCE * 5e-4 / 1e5)


@from_text("old", "new", "said")
def test_what_cannot_be_is_said_in_one_line(write, old, new, said):
    with pytest.raises(ConfigError) as refused:
        load_config(write(old, new))
    assert said in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_supply_without_a_filter_cannot_have_one_clogged():
    config = load_config(tables={"plant": {"axis1": {"supply": "unit"}}})
    with VirtualBench(config) as bench, pytest.raises(ConfigError) as refused:
        bench.faults.clog_filter("axis1")
    assert str(refused.value).startswith("faults: axis1 has no filter of its own; give filter_r")
