"""Two records of a machine: a defect between them is named, and noise is none."""

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench import ConfigError, load_config
from hil_bench.abilities.identification import against
from hil_bench.abilities.identification.against import (
    Change,
    Comparison,
    compare,
    describe,
    find_alike,
    find_changes,
    find_likely,
    to_json,
)
from hil_bench.abilities.identification.fit import Clock, Fit
from hil_bench.abilities.identification.identify import Options, make_coarse
from hil_bench.abilities.identification.record import AxisRecord, join_records
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

CONFIG = load_config(None)
AXIS = cast("CylinderConfig", CONFIG.first_axis)
SETTINGS = {one.key.name: one for one in CONFIG.settings if one.table == "plant.axis1"}
SOUND = Machine(tick=4e-3, step=5e-4)
PARTS = [np.zeros(75)]
for _opening in (0.5, -0.5, 0.8, -0.8):
    PARTS += [np.full(100, _opening * FULL_OPENING), np.zeros(75)]
STROKES = np.concatenate(PARTS)


STOOD = SimpleNamespace(best=SimpleNamespace(fit=SimpleNamespace(values={})))
"""A ladder that has found nothing to be other than the sheet has it."""


def record_of(machine):
    return AxisRecord.of(machine.record(STROKES), "axis1", FULL_OPENING)


@pytest.fixture(scope="module")
def before():
    return record_of(SOUND)


def compared(before, machine):
    held = {"bulk_modulus_mpa", "moving_mass_kg", "spool_natural_frequency_rad_s"}
    wish = Options().wish._replace(fix=frozenset(held))
    return compare(before, record_of(machine), AXIS, SETTINGS, Options(wish))


@pytest.mark.long
def test_the_same_machine_has_not_changed(before):
    found = compared(before, replace(SOUND, state=None))

    assert not found.is_changed
    assert found.changes == ()
    assert describe(found)[0].endswith(" times)")
    assert all(0.0 <= one.explains <= 1.0 for one in found.tried)


def test_strokes_that_were_not_compared_are_said(before, monkeypatch):
    """The last two strokes are at an opening of 0.6 in place of 0.8, which none before is like."""
    other = STROKES.copy()
    other[len(np.concatenate(PARTS[:5])) :] *= 0.75
    later = AxisRecord.of(SOUND.record(other), "axis1", FULL_OPENING)
    monkeypatch.setattr(against, "_explain", lambda *_: Comparison(1.0, (), ()))
    monkeypatch.setattr(against, "climb", lambda *_, **__: STOOD)

    found = compare(before, later, AXIS, SETTINGS, Options())

    assert describe(found) == [
        "nothing has changed: it fits as before (1.00 times), in 2 of 4 strokes"
    ]
    assert to_json(found)["seen"] == "in 2 of 4 strokes"


@pytest.mark.long
def test_a_sensor_that_is_off_is_named_with_its_offset(before):
    found = compared(before, replace(SOUND, offset=1.5e5))

    assert found.is_changed
    assert found.changes[0].words == "the sensor of P_A reads more"
    change = found.changes[0].after - found.changes[0].before
    assert change == pytest.approx(1.5, abs=0.15)  # bar


@pytest.mark.long
def test_a_sensor_that_is_off_in_several_recordings_is_named(before):
    off = record_of(replace(SOUND, offset=1.5e5))
    held = {"bulk_modulus_mpa", "moving_mass_kg", "spool_natural_frequency_rad_s"}
    wish = Options().wish._replace(fix=frozenset(held))

    found = compare(before, join_records([off, off]), AXIS, SETTINGS, Options(wish))

    assert found.changes[0].words == "the sensor of P_A reads more"
    assert found.changes[0].explains > 0.9  # of both recordings, and not of the first alone
    change = found.changes[0].after - found.changes[0].before
    assert change == pytest.approx(1.5, abs=0.15)  # bar


def test_recordings_without_like_strokes_are_refused(before):
    others = AxisRecord.of(SOUND.record(0.8 * STROKES), "axis1", FULL_OPENING)
    first, second = (make_coarse(one, AXIS, SETTINGS, 1, Clock()) for one in (before, others))

    assert find_alike(first, second) == [[], [], [], []]
    assert find_alike(first, first) == [[0], [1], [2], [3]]


def test_strokes_are_alike_that_go_the_same_way_as_often_changed_at_like_openings(monkeypatch):
    """In three hundredths of the full opening, which is not met exactly."""

    def course(*strokes):
        made = [SimpleNamespace(is_forth=f, opening=o, changes=c) for f, o, c in strokes]
        return SimpleNamespace(course=SimpleNamespace(strokes=made))

    monkeypatch.setattr(against, "find_changes", lambda _bench, stroke: [0.0] * stroke.changes)
    one = course((True, 0.50, 1), (False, 0.50, 1))
    other = course((True, 0.529, 1), (True, 0.531, 1), (True, 0.471, 1), (True, 0.50, 2))
    assert find_alike(one, other) == [[0, 2], []]
    assert find_alike(other, one) == [[0], [], [0], []]


def test_a_step_inside_a_row_is_found_by_the_row_mean(before):
    record = replace(before, setpoints=before.setpoints.copy())
    bench = make_coarse(record, AXIS, SETTINGS, 1, Clock())
    stroke = bench.course.strokes[1]
    setpoints = bench.course.record.setpoints
    row = stroke.rows.start + 40
    setpoints[row] = 0.25 * setpoints[row - 1]  # three quarters of the row have the new one
    setpoints[row + 1 :] = 0.0

    assert find_changes(bench, stroke)[-1] == pytest.approx(39.0 - 0.75)


def test_a_comparison_without_time_says_so(before):
    with pytest.raises(ConfigError, match="the time was over before the comparison"):
        compare(before, before, AXIS, SETTINGS, Options(seconds=1e-9))


@pytest.mark.long
def test_leakage_to_the_tank_is_told_from_other_leakage(before):
    leaky = replace(PlantOptions.bench(), C_LA=2e-12)

    found = compared(before, replace(SOUND, options=leaky))

    assert found.changes[0].words == "leakage from A to the tank"
    # 2e-12 m3/(s Pa) in l/min/bar
    assert found.changes[0].after == pytest.approx(2e-12 * 6e4 * 1e5, rel=0.1)


@pytest.mark.long
def test_less_supply_is_named(before):
    weak = replace(paper_parameters(), P_S=9.3e6)

    found = compared(before, replace(SOUND, parameters=weak))

    assert found.changes[0].words == "lower supply pressure"
    assert found.changes[0].after == pytest.approx(93.0, abs=0.5)


def test_a_cause_that_differs_daily_is_sought_from_where_it_has_gone_already(before, monkeypatch):
    """Of a supply 12 % lower the search from no change ended half-way, behind five others."""
    begins = []

    def moved(_bench, unknowns, begin, *_rest):
        begins.append({one.name: value for one, value in zip(unknowns, begin, strict=True)})
        return Fit(tuple(unknowns), np.asarray(begin) + 0.01, 1.0, is_whole=True)

    monkeypatch.setattr(against, "search", moved)
    first, second = (make_coarse(before, AXIS, SETTINGS, 1, Clock()) for _ in range(2))
    against._explain(first, second, Options())

    _, again, *alone = begins
    sought = {next(iter(each)): each for each in alone[: len(alone) - against._LOOKED_AT]}
    for name in ("supply_pressure_bar", "coulomb_friction_n", "offset_a:0"):
        assert sought[name][name] == pytest.approx(again[name] + 0.01)
    at_rest = sought["external_leakage_a_l_min_bar"]["supply_pressure_bar"]
    assert at_rest == second.template.unknown("supply_pressure_bar").start


def test_of_causes_that_explain_everything_the_likelier_is_named():
    worn, air = (
        Change(words, "", before=0.0, after=1.0, explains=1.0)
        for words in ("worn edges of the spool", "air trapped in the oil")
    )

    assert find_likely([(20.0, worn), (80.0, air)], 5.0) == (air,)


def test_causes_that_are_about_as_likely_are_both_named_the_better_first():
    worn, air = (
        Change(words, "", before=0.0, after=1.0, explains=1.0)
        for words in ("worn edges of the spool", "air trapped in the oil")
    )

    assert find_likely([(70.0, worn), (80.0, air)], 5.0) == (air, worn)
    assert find_likely([(67.0, worn), (80.0, air)], 5.0) == (air,)  # 0.84 of the best
    assert find_likely([], 5.0) == ()


def test_nothing_is_named_where_like_strokes_differ_as_much_among_themselves():
    leakage = Change("leakage across the piston", "", before=0.0017, after=0.003, explains=1.0)

    assert find_likely([(80.0, leakage)], -1.0) == ()
    assert find_likely([(80.0, leakage)], 0.1) == (leakage,)


def test_a_cause_that_explains_little_is_not_the_whole_story():
    name = "supply_pressure_bar"
    less = Change("lower supply pressure", name, before=100.0, after=90.0, explains=0.05)
    few = Comparison(9.0, (less,), (less,))
    whole = Comparison(9.0, (less._replace(explains=0.5), less), ())

    assert describe(few)[2:] == [
        "  most of it stays: more has changed than that, or the machine is another"
    ]
    assert len(describe(whole)) == 3  # both causes, and no more
