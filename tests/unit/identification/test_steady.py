"""Plateaus of strokes: found where speed stands, and what their fit says of a machine."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench.abilities.identification.fit import Bench, _start, find_middle
from hil_bench.abilities.identification.ladder import STEADY, find_accumulator
from hil_bench.abilities.identification.machine import DROOP, GAS, PUMP, Template, read_values
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.steady import find_plateaus, fit_plateaus
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion

CONFIG = load_config(None)
SETTINGS = {one.key.name: one for one in CONFIG.settings if one.table == "plant.axis1"}


STIFF = replace(paper_parameters(), w=0.023, E=1e9)
DRAINED = {DROOP: 0.05, PUMP: 0.35, GAS: 0.5}
"""bar min/l; of the valve's largest flow; litres, of which a stroke takes up to a fifth."""


@pytest.fixture(scope="module")
def bench():
    return record_strokes(PlantOptions.bench(), (0.4, 0.7), 60)


@pytest.fixture(scope="module")
def drained():
    """Strokes that draw more than the pump gives, and rests in which that comes back."""
    options = Template(CONFIG.first_axis, SETTINGS, 1).run(DRAINED, 1e-4).options
    return record_strokes(options, (0.4, 0.7, 1.0), 200)


def record_strokes(options, openings, rest):
    parts = [np.zeros(rest)]
    for opening in openings:
        for sign in (1.0, -1.0):
            parts += [np.full(round(75 / opening), sign * opening * FULL_OPENING), np.zeros(rest)]
    machine = Machine(parameters=STIFF, options=options, tick=4e-3, step=2.5e-4)
    record = AxisRecord.of(machine.record(np.concatenate(parts)), "axis1", FULL_OPENING, "run.csv")
    return Bench(Template(CONFIG.first_axis, SETTINGS, 1), make_course(record, 4e-3), 1e-3)


def test_speeds_are_those_of_steady_motion(bench):
    """The equations of the steady state do not know the run that made the record."""
    parameters = replace(paper_parameters(), w=0.023, E=1e9)
    plateaus = find_plateaus(bench)

    assert len(plateaus) == 4
    for one in plateaus:
        z = abs(one.setpoint) - parameters.beta
        right = steady_motion(parameters, PlantOptions.bench(), extends=one.setpoint > 0.0, z=z)
        assert one.speed == pytest.approx(right.speed, rel=5e-3)
        assert one.pressures == pytest.approx([right.P_A, right.P_B], abs=0.3e5)


def test_a_stroke_without_a_plateau_hides_no_other(bench):
    first, *others = bench.course.strokes
    short = first._replace(rows=range(first.rows.start, first.rows.start + 6))
    course = replace(bench.course, strokes=(short, *others))

    found = find_plateaus(replace(bench, course=course))

    assert [one.setpoint for one in found] == [one.setpoint for one in find_plateaus(bench)[1:]]


def test_the_fit_of_plateaus_finds_the_valve(bench):
    names = ("orifice_width_mm", "spool_overlap_mm", "coulomb_friction_n", "viscous_friction_n_s_m")
    unknowns = [bench.template.unknown(name) for name in names]

    found, _ = fit_plateaus(bench, unknowns, np.array([one.start for one in unknowns]))

    width = dict(zip(names, found.tolist(), strict=True))["orifice_width_mm"]
    assert unknowns[0].value(width) == pytest.approx(23.0, rel=0.02)  # 20 before


def test_a_stroke_starts_at_rest_but_for_its_piston(bench):
    """Position, speed, pressures, spool and supply pressure; all other states are 0."""
    stroke = bench.course.strokes[0]
    found = _start(bench.machine({}), stroke, 0.25, (2e7, 0.0))
    assert found == pytest.approx([*stroke.start, 0.25, 0.0, 0.0, 0.0, 2e7, 0.0, 0.0, 0.0])


def test_a_middle_needs_a_set_point_that_stands():
    way = np.stack([np.linspace(0.0, 0.1, 100)] * 3, axis=1)
    steady, ramp = np.full(100, 0.5), np.linspace(0.0, 0.5, 100)

    assert find_middle(way, steady, 1.0) == range(35, 65)
    assert find_middle(way, ramp, 1.0) is None
    assert find_middle(np.zeros((100, 3)), steady, 1.0) is None


def test_plateaus_show_the_pump_and_its_accumulator(drained):
    """The record is the plant's, which integrates the supply pressure; plateaus only reckon it."""
    names = ("orifice_width_mm", "spool_overlap_mm", "coulomb_friction_n", "viscous_friction_n_s_m")
    own, values = find_accumulator(drained, names, {}, math.inf)
    unknowns, begin = own.begin((*names, DROOP, PUMP, GAS), values)

    variables, _ = fit_plateaus(drained, unknowns, begin)

    found = read_values(unknowns, variables)
    assert found["orifice_width_mm"] == pytest.approx(23.0, rel=0.02)
    assert found[PUMP] == pytest.approx(DRAINED[PUMP], rel=0.05)
    assert found[GAS] == pytest.approx(DRAINED[GAS], rel=0.2)


def test_no_accumulator_is_found_where_a_supply_holds_its_pressure(bench):
    unknowns = [bench.template.unknown(name) for name in STEADY]
    _, stiff = fit_plateaus(bench, unknowns, np.array([one.start for one in unknowns]))
    assert find_accumulator(bench, STEADY, {}, stiff) is None
