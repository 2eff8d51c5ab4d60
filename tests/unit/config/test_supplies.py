"""``[supply.NAME]``: several axes on one supply, from the file to the bench."""

import json
import re
from itertools import pairwise

import pytest
from support.tables import from_text

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.bench.configuration.plausibility import find_doubts

BENCH = """
[supply.hpu]
pump_flow_l_min = 30
relief_pressure_bar = 150
supply_pressure_bar = 150
accumulator_volume_l = 2
accumulator_precharge_bar = 90

[plant.lift]
supply = "hpu"

[plant.clamp]
supply = "hpu"
orifice_width_mm = 5
position_mm = -50

[plant.alone]

[nodes]
lift_valve = { profile = "valve_408", axis = "lift", node_id = 1 }
clamp_valve = { profile = "valve_408", axis = "clamp", node_id = 2 }
alone_valve = { profile = "valve_408", axis = "alone", node_id = 3 }
[nodes.port]
profile = "pressure_404"
axis = "clamp"
source = "P_S"
span_bar = [0, 250]
node_id = 4
"""


@pytest.fixture
def write(tmp_path):
    def write(text=BENCH, old="", new=""):
        path = tmp_path / "bench.toml"
        path.write_text(text.replace(old, new, 1) if old else text)
        return path

    return write


def refusal(path):
    with pytest.raises(ConfigError) as refused:
        load_config(path)
    return str(refused.value).replace(f"{path}:", "")


def opened(bench, **shares):
    """Open valves at once and for good, without their devices."""
    for axis in bench.bench.axes:
        share = shares.get(axis.name, 0.0)
        axis.command_path.add(lambda _u, u=share * axis.valve.full_opening: u)
    return bench


def test_axes_have_the_pressures_of_their_supply(write):
    config = load_config(write())
    (supply,) = config.supplies
    lift, clamp, alone = config.axes
    assert supply.axes == ("lift", "clamp")
    assert supply.unit == lift.options.supply == clamp.options.supply
    assert supply.modulus == 1.4e9
    assert (lift.parameters.P_S, clamp.parameters.P_S) == (150e5, 150e5)
    assert alone.options.supply is None
    names = [[quantity.name for quantity in axis.kind.quantities] for axis in config.axes]
    assert names[0] == names[1] == [*names[2], "P_S", "Q_S", "T_oil"]


def test_check_says_where_the_values_of_an_axis_come_from_and_loads_again(write, cli, make_file):
    text = cli(["check", str(write())]).out
    assert re.search(r"\n# relief_pressure_bar = 150 +# from supply.hpu\n", text)
    again = make_file("again.toml", text)
    assert load_config(again).supplies == load_config(write()).supplies
    assert load_config(again).axes[1].parameters == load_config(write()).axes[1].parameters


def test_check_sums_up_what_the_supply_can_give(write, cli):
    summary = json.loads(cli(["check", "--json", str(write())]).out)["summary"]
    found = {fact["name"].strip(): fact["value"] for fact in summary["hpu"]}
    assert found["flow of the pump"] == pytest.approx(30.0)
    # P_R + Q / G = 150 bar + 30 l/min / 12 l/(min bar)
    assert found["pressure at rest"] == pytest.approx(152.5)
    # 2 l (1 - (91.01 bar / 151.01 bar)^(1/1.4)), and 60 bar * 0.5 l / 1400 MPa
    assert found["oil in the accumulator"] == pytest.approx(0.6070 + 0.0021, abs=2e-4)


def test_a_fast_axis_starves_the_other_one(write):
    config = load_config(write())
    with VirtualBench(config) as one, VirtualBench(config) as both:
        opened(one, clamp=1.0).run(0.6)
        opened(both, clamp=1.0, lift=1.0).run(0.6)
        alone, starved = one.signals, both.signals
    assert max(alone["clamp.P_S"][500:]) == pytest.approx(151e5, abs=2e5)
    assert starved["clamp.P_S"][-1] < 60e5
    assert starved["clamp.speed"][-1] < 0.6 * alone["clamp.speed"][-1]
    assert all(starved["clamp.P_S"] == starved["lift.P_S"])
    drawn = starved["clamp.Q_S"][-1] + starved["lift.Q_S"][-1]
    assert drawn > 30e-3 / 60.0  # the pump's flow, and what the accumulator still gives
    assert starved["port.measured"][-1] == pytest.approx(starved["clamp.P_S"][-1], abs=1e5)


def test_an_axis_of_its_own_does_not_notice(write):
    config = load_config(write())
    with VirtualBench(config) as bench, VirtualBench(load_config()) as plain:
        opened(bench, lift=1.0, alone=0.5).run(0.3)
        opened(plain, axis1=0.5).run(0.3)
        assert list(bench.signals["alone.position"]) == list(plain.signals["axis1.position"])


@pytest.mark.parametrize(
    ("fault", "amount"),
    [("wear_pump", {"share": 1.0}), ("sag_relief", {"pressure": 100e5}), ("lose_gas", {})],
)
def test_faults_of_the_supply_befall_all_of_its_axes(write, fault, amount):
    config = load_config(write())
    with VirtualBench(config) as sound, VirtualBench(config) as worn:
        getattr(worn.faults, fault)("hpu", at=0.0, **amount)
        for bench in (sound, worn):
            opened(bench, lift=0.6).run(0.25)
        assert worn.signals["clamp.P_S"][-1] < sound.signals["clamp.P_S"][-1] - 5e5
        assert worn.signals["lift.speed"][-1] < sound.signals["lift.speed"][-1]


def test_a_relief_valve_that_sticks_open_holds_its_lower_pressure(write):
    with VirtualBench(load_config(write())) as bench:
        bench.faults.sag_relief("hpu", 50e5, at=0.0)
        bench.run(3.0)
        # 100 bar + 30 l/min / 12 l/(min bar)
        assert bench.signals["lift.P_S"][-1] == pytest.approx(102.5e5, rel=1e-3)


def test_the_pressure_is_held_for_all_by_the_name_of_the_supply_or_of_an_axis(write):
    for name in ("hpu", "clamp"):
        with VirtualBench(load_config(write())) as bench:
            bench.faults.drop_supply(name, 95e5, at=0.1, duration=0.1)
            bench.run(0.2)
            held = bench.signals["lift.P_S"][150:200]
            # a tick of 30 l/min into gas of V / (n p) = 1.92 l / 135 bar: 35 mbar
            assert all(95e5 <= pressure < 95.1e5 for pressure in held)
            bench.run(0.1)
            risen = bench.signals["lift.P_S"][-80:]
            assert all(a <= b for a, b in pairwise(risen))


def test_a_motor_shares_a_supply_with_a_cylinder(write):
    motor = """
[plant.drum]
kind = "rotary"
supply = "hpu"
displacement_cm3_rev = 28
inertia_kg_m2 = 0.05
rated_flow_l_min = 40
rated_pressure_drop_bar = 35
overlap_percent = 3
frequency_90deg_hz = 60
oil = "HLP 46"
[nodes.drum_valve]
profile = "valve_408"
axis = "drum"
node_id = 9
"""
    with VirtualBench(load_config(write(BENCH + motor))) as bench:
        opened(bench, drum=1.0).run(0.4)
        signals = bench.signals
    assert signals["drum.P_S"][-1] < 145e5
    assert signals["drum.Q_S"][-1] == pytest.approx(
        signals["drum.speed"][-1] * 28e-6 / 6.283185307, rel=0.03
    )


@from_text("old", "new", "said")
def test_what_cannot_be_is_said_in_one_line(write, old, new, said):
    assert said in refusal(write(BENCH, old, new))


def test_a_pascal_in_a_bar_key_is_doubted(write):
    path = write(BENCH, "supply_pressure_bar = 150", "supply_pressure_bar = 2000")
    assert any(
        "supply.hpu.supply_pressure_bar: 2000" in each for each in find_doubts(load_config(path))
    )


MOTOR = """kind = "rotary"
displacement_cm3_rev = 28
inertia_kg_m2 = 0.01
"""
LINE = """line_model = "waves"
line_a_length_m = 2
line_a_inner_mm = 12
"""


@pytest.mark.parametrize(
    "more",
    ["", pytest.param(LINE, marks=pytest.mark.long), MOTOR],
    ids=["cylinder", "line", "motor"],
)
def test_an_own_unit_shows_what_the_steady_motion_draws_from_it(write, more):
    """The pump limits the motion: all of its flow goes to the axis, none over the relief valve."""
    text = f'[plant.axis1]\nsupply = "unit"\npump_flow_l_min = 3\n{more}'
    with VirtualBench(load_config(write(text))) as bench:
        opened(bench, axis1=1.0).run(1.5)
        signals = bench.signals
        drawn = signals["axis1.Q_S"][-500:].mean() * 6e4  # over its swings
        assert drawn == pytest.approx(3.0, rel=0.01)
        assert signals["axis1.P_S"][-1] < 50e5  # set to 100 bar, Table I
