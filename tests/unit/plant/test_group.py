"""Cylinders of a group against the same cylinders, each moved on by itself: bit for bit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder import cylinder
from hil_bench.plants.hydraulic_cylinder.cylinder import (
    FEWEST,
    CylinderGroup,
    FullOrderCylinder,
    group_cylinders,
)
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.moving import is_machine_code
from hil_bench.plants.plant import SUPPLY

STEPS = 20

pytestmark = pytest.mark.skipif(
    not is_machine_code(), reason="kernels run as Python: all move one by one"
)


def cylinders(count, *, extended=frozenset()):
    """Return as many cylinders, no two of them alike; those named hold a leak to the tank."""
    paper, bench = paper_parameters(), PlantOptions.bench()
    return [
        FullOrderCylinder(
            replace(paper, m=paper.m * (1.0 + 0.1 * number)),
            options=replace(bench, C_LA=1e-12) if number in extended else bench,
        )
        for number in range(count)
    ]


def play(alone, grouped, ticks, *, events=None):
    """Move both on under the same random commands and loads; all that is seen must be equal."""
    draw = np.random.default_rng(7)
    joint = group_cylinders(grouped)
    commands = [0.0] * len(alone)
    for tick in range(ticks):
        if tick % 25 == 0:
            commands = draw.uniform(-1.2e-3, 1.2e-3, len(alone)).tolist()
            chosen, load = draw.integers(len(alone)), draw.uniform(-40e3, 40e3)
            for side in (alone, grouped):
                side[chosen].influence("load", load)
        for act in (events or {}).get(tick, ()):
            act(alone)
            act(grouped)
        expected = [each.drive(u, STEPS) for each, u in zip(alone, commands, strict=True)]
        moved = joint.drive(commands, STEPS)
        assert [tuple(seen) for seen in moved] == [tuple(seen) for seen in expected], tick
        assert [each.output for each in grouped] == [each.output for each in alone]
        assert [each.state for each in grouped] == [each.state for each in alone]
    evaluations = [each.extra_evaluations for each in alone]
    assert [each.extra_evaluations for each in grouped] == evaluations
    return evaluations


@pytest.mark.parametrize("count", [FEWEST, 8, 11])  # a part of a block, a whole one, and more
def test_a_group_gives_the_bits_of_single_plants(count):
    evaluations = play(cylinders(count), cylinders(count), 400)
    assert min(evaluations) > 0  # steps were made in parts as well


def test_influences_and_wear_reach_a_plant_of_a_group():
    def weaken(plants):
        plants[1].influence(SUPPLY, 60e5)
        plants[2].influence("internal_leakage", 2e-12)

    def heal(plants):
        plants[1].influence(SUPPLY, None)
        plants[2].influence("internal_leakage", None)

    def restart(plants):
        plants[0].go_to({"position": 0.02, "P_A": 30e5})

    play(cylinders(4), cylinders(4), 300, events={50: [weaken], 150: [restart], 200: [heal]})


def test_a_plant_that_a_defect_extends_leaves_the_group_and_all_go_on():
    def leak(plants):
        plants[2].influence("leakage_a", 1e-11)

    def leak_more(plants):
        plants[0].influence("null_opening", 2e-5)

    events = {60: [leak], 120: [leak_more]}
    play(cylinders(4), cylinders(4), 200, events=events)  # four, then three, then none together


def test_a_group_moves_plants_with_extensions_beside_the_others():
    play(cylinders(5, extended={1, 3}), cylinders(5, extended={1, 3}), 100)


def test_commands_beyond_the_limits_act_as_on_single_plants():
    alone, grouped = cylinders(3), cylinders(3)
    commands = [5.0, -1e-3, 0.0]
    alone[1].load = grouped[1].load = 3e9
    expected = [each.drive(u, STEPS) for each, u in zip(alone, commands, strict=True)]
    assert CylinderGroup(grouped).drive(commands, STEPS) == expected


def test_a_command_that_is_no_number_is_refused_before_any_plant_moves():
    grouped = cylinders(3)
    joint = CylinderGroup(grouped)
    before = [each.state for each in grouped]
    with pytest.raises(ParameterError, match="u = nan m"):
        joint.drive([math.nan, 1e-3, 1e-3], STEPS)
    assert [each.state for each in grouped] == before


def test_a_plant_that_has_left_the_finite_numbers_is_refused():
    grouped = cylinders(3)
    joint = CylinderGroup(grouped)
    grouped[1]._state[1] = math.nan  # no input leads there with this solver
    with pytest.raises(ParameterError, match="has diverged"):
        joint.drive([1e-3] * 3, STEPS)


@pytest.mark.parametrize(
    ("count", "extended", "is_grouped"),
    [
        (FEWEST, set(), True),
        (FEWEST - 1, set(), False),
        (FEWEST, {0}, False),
        (FEWEST + 1, {0}, True),
    ],
)
def test_only_enough_plants_without_extensions_make_a_group(count, extended, is_grouped):
    assert (group_cylinders(cylinders(count, extended=extended)) is not None) is is_grouped


def test_without_numba_plants_move_one_by_one(monkeypatch):
    monkeypatch.setattr(cylinder, "is_machine_code", lambda: False)
    assert group_cylinders(cylinders(FEWEST)) is None


def test_a_bench_groups_the_cylinders_among_its_axes():
    motor = {"kind": "rotary", "displacement_cm3_rev": 28, "inertia_kg_m2": 0.02}
    plants = {f"axis{number}": motor if number == 1 else {} for number in range(5)}
    nodes = {
        f"valve{number}": {"profile": "valve_408", "node_id": number + 1, "axis": f"axis{number}"}
        for number in range(5)
    }
    bench = build_bench(load_config(tables={"plant": plants, "nodes": nodes}))
    assert bench.single == [1]
    assert [numbers for numbers, _ in bench.groups] == [(0, 2, 3, 4)]
