"""From records of machines to the machines: parameters, predictions, and the ladder's choice."""

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench.abilities.identification.bench_file import write_bench
from hil_bench.abilities.identification.errors import stated_error
from hil_bench.abilities.identification.fit import Bench, Clock, Fit, Problem
from hil_bench.abilities.identification.identify import Options, identify
from hil_bench.abilities.identification.ladder import (
    PLATEAUS,
    THE_PAPERS,
    WHOLE,
    Rung,
    Wish,
    choose_folds,
    choose_rung,
    climb,
    find_free,
)
from hil_bench.abilities.identification.machine import Template, read_values
from hil_bench.abilities.identification.plot import draw_strokes
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.report import error_lines, summarise
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.abilities.identification.verbs.identify import check_plausible
from hil_bench.bench.configuration import load_config
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

CONFIG = load_config(None)
AXIS = cast("CylinderConfig", CONFIG.first_axis)
SETTINGS = {one.key.name: one for one in CONFIG.settings if one.table == "plant.axis1"}
TICK = 4e-3
REST = 100  # rows


def strokes(*openings):
    """Return set-points [m] that go out and in at each share of the full opening."""
    parts = [np.zeros(REST)]
    for opening in openings:
        rows = round(0.3 / (TICK * opening))
        for sign in (1.0, -1.0):
            parts += [np.full(rows, sign * opening * FULL_OPENING), np.zeros(REST)]
    return np.concatenate(parts)


def record_of(machine, setpoints):
    return AxisRecord.of(machine.record(setpoints), "axis1", FULL_OPENING, "run.csv")


MACHINE = Machine(
    parameters=replace(paper_parameters(), w=0.023, sigma=2600.0), tick=TICK, step=5e-4
)


@pytest.fixture(scope="module")
def record():
    return record_of(MACHINE, strokes(0.4, 0.6, 0.85))


def test_a_record_is_cut_at_its_rests(record):
    course = make_course(record, 4e-3)

    assert [round(one.opening, 2) for one in course.strokes] == [0.4, 0.4, 0.6, 0.6, 0.85, 0.85]
    assert [one.is_forth for one in course.strokes] == [True, False] * 3
    assert all(one.start[1] == 0.0 for one in course.strokes)  # from rest


@pytest.mark.parametrize("every", [1, 2, 3, 4, 8])
def test_a_step_inside_a_row_stays_where_it_was(record, every):
    """Steps of the solver have the mean set-point of their own time, not that of the whole row."""
    record = replace(record, setpoints=np.roll(record.setpoints, 1))  # between two rows of 8 ms
    course = make_course(record, 4.0 * TICK)  # 8 ms at most: two rows of the record make one
    stroke = course.strokes[0]
    first, last = 2 * stroke.rows.start + 1, 2 * (stroke.rows.stop - 1) + 1
    dense = np.repeat(record.setpoints[first:last], 12)  # 24 a row: each `every` divides it

    found = course.commands_of(stroke, every)

    assert course.record.interval == pytest.approx(2.0 * TICK)
    assert found == pytest.approx(dense.reshape(-1, 24 // every).mean(axis=1))


@pytest.mark.parametrize("rows", [0, 1])
def test_a_stroke_of_thinned_rows_begins_before_its_set_point_steps(record, rows):
    """Wherever that is between two of these rows: a late start has the spool open at once."""
    setpoints, measured = (
        np.concatenate([one[:rows], one[: len(one) - rows]])  # so much later
        for one in (record.setpoints, record.measured)
    )
    record = replace(record, setpoints=setpoints, measured=measured)

    course = make_course(record, 2.0 * TICK)

    opened = [np.count_nonzero(course.commands_of(one, 2)) for one in course.strokes]
    assert course.record.interval == pytest.approx(2.0 * TICK)
    assert opened == [round(0.3 / (TICK * one)) for one in (0.4, 0.4, 0.6, 0.6, 0.85, 0.85)]


def test_a_set_point_of_a_logger_changed_between_two_rows(record):
    """The row of a logger has the set-point of its moment, that of a bench the one before it."""
    ours, logged = (
        make_course(replace(record, is_sampled=is_sampled), TICK) for is_sampled in (False, True)
    )
    steps = [each.commands_of(each.strokes[0], 10) for each in (ours, logged)]

    # half of ten steps a row
    assert logged.strokes[0].rows == ours.strokes[0].rows
    assert np.array_equal(steps[1][5:], steps[0][:-5])
    assert not np.array_equal(steps[1], steps[0])


@pytest.mark.parametrize("hidden", [1, 2])
def test_a_pressure_that_was_not_recorded_goes_on_from_the_stroke_before(hidden):
    """Its stop holds the piston, not the other pressure: one is at P_S, the other at P_T."""
    rest = np.zeros(REST)
    parts = [np.full(500, share * FULL_OPENING) for share in (0.6, -0.6)]  # 2 s, into each stop
    record = record_of(MACHINE, np.concatenate([rest, parts[0], rest, parts[1], rest]))
    measured = record.measured.copy()
    measured[:, hidden] = np.nan
    bench = Bench(
        Template(AXIS, SETTINGS, 1), make_course(replace(record, measured=measured), TICK), 5e-4
    )
    machine = bench.machine({"orifice_width_mm": 23.0, "viscous_friction_n_s_m": 2600.0})

    shown = bench.run(machine, bench.cuts())[1]

    rows = bench.course.strokes[1].rows
    assert abs(record.measured[rows.start, 0]) > 0.99 * AXIS.parameters.h
    assert shown[:, hidden] == pytest.approx(
        record.measured[rows.start + 1 : rows.stop, hidden], abs=1e5
    )


@pytest.mark.parametrize(
    ("reach", "beyond", "shares"),
    [
        (np.inf, 1e3, (1.0, 1.0)),
        (0.3, 1e3, (0.25, 0.25)),
        (0.3, 1.5, (1.0, 0.25)),
        (0.0, 1e3, (0.0, 0.0)),
    ],
)
def test_a_fit_without_strokes_is_that_of_the_others_and_of_what_is_expected(
    record, reach, beyond, shares
):
    """Where a residual is linear, one step of Newton is the least squares of what stays.

    Where it is linear for a part of the way alone, a step that chooses ends before, and one that
    says how far off a prediction may be where the others are lost: as where there is no machine.
    """
    bench = Bench(Template(AXIS, SETTINGS, 1), make_course(record, 4e-3), 1e-3)
    names = ("orifice_width_mm", "viscous_friction_n_s_m")
    unknowns = [bench.template.unknown(name) for name in names]
    source = np.random.default_rng(2)

    class Line(Problem):
        def _at(self, variables, _cuts):
            expected = self.doubt * (variables - self.start) / self.spread
            missed = rows @ variables - shown
            way = (variables - here) @ (right - here)
            if way > reach * (right - here) @ (right - here):
                missed = beyond * (missed if beyond < 2.0 else np.ones_like(missed))
            return np.concatenate([missed, expected])

    line = Line(bench, unknowns)
    rows = source.standard_normal((sum(line.lengths), 2))
    rows[: line.lengths[0], 0] *= 30.0  # mostly the first stroke shows the width
    here = np.array([0.05, 0.4])
    shown = rows @ [0.05, 0.4] + 0.5 * source.standard_normal(len(rows))
    whole = np.eye(2) * (line.doubt / line.spread)
    stays, starts = rows[line.lengths[0] :], whole @ line.start
    right = np.linalg.lstsq(
        np.concatenate([stays, whole]),
        np.concatenate([shown[line.lengths[0] :], starts]),
        rcond=None,
    )[0]

    line.slopes = lambda _variables: np.concatenate([rows, whole])
    line._residuals = np.concatenate([rows @ here - shown, whole @ (here - line.start)])
    found = list(line.without(here, [[0], [0]], 1))

    expected = [here + share * (right - here) for share in shares]
    assert found == [pytest.approx(each, abs=1e-6) for each in expected]


def test_a_fit_at_the_edge_of_what_a_machine_may_be_stays(record, monkeypatch):
    """Whatever its strokes say: there is no machine elsewhere."""
    bench = Bench(Template(AXIS, SETTINGS, 1), make_course(record, 4e-3), 1e-3)
    names = ("orifice_width_mm", "viscous_friction_n_s_m")
    unknowns = [bench.template.unknown(name) for name in names]
    here, run = np.array([0.05, 0.4]), Template.run

    def only_here(template, values, dt):
        if values != read_values(unknowns, here):
            raise ParameterError("no machine")
        return run(template, values, dt)

    problem = Problem(bench, unknowns)
    slopes = problem.slopes(here)
    problem.slopes = lambda _variables: slopes
    monkeypatch.setattr(Template, "run", only_here)

    assert [each.tolist() for each in problem.without(here, [[0], [0]], 1)] == [[0.05, 0.4]] * 2


def test_slopes_of_modulus_and_mass_are_those_that_the_cost_has(record):
    """They set the pace of one swing: where both grow their slopes nearly cancel, and errors stay.

    Beside them the cost itself, a little before and behind.
    """
    bench = Bench(Template(AXIS, SETTINGS, 1), make_course(record, 4e-3), 5e-4)
    names = ("bulk_modulus_mpa", "moving_mass_kg")
    problem = Problem(bench, [bench.template.unknown(name) for name in names])
    here, aside = np.array([0.1, 0.1]), np.array([1e-4, 1e-4])
    costs = [0.5 * np.square(problem.residuals(here + aside * way)).sum() for way in (-1.0, 1.0)]

    gradient = problem.slopes(here).T @ problem.residuals(here)

    assert gradient @ aside == pytest.approx(0.5 * (costs[1] - costs[0]), rel=0.01)


def test_a_blurred_residual_is_the_mean_of_the_rows_about_it_that_count():
    """Of three rows each; the ends count twice, as rows beyond them are like them."""
    course = SimpleNamespace(record=SimpleNamespace(interval=TICK))
    problem = SimpleNamespace(bench=SimpleNamespace(blur=3 * TICK, course=course))
    rows = np.array([[3.0, 0.0], [6.0, 0.0], [np.nan, 9.0], [12.0, 0.0]])
    found = Problem._blurred(problem, rows, np.isfinite(rows))
    # By hand, (3 + 3 + 6) / 3, 0; (3 + 6) / 2, (0 + 0 + 9) / 3; 3; 12, (9 + 0 + 0) / 3.
    assert found == pytest.approx([4.0, 0.0, 4.5, 3.0, 3.0, 12.0, 3.0])


def test_of_a_machine_with_a_load_the_mass_of_the_load_is_free(record):
    loaded = SETTINGS | {"load_mass_kg": SETTINGS["load_mass_kg"]._replace(value=460.0)}
    course = make_course(record, 4e-3)
    names = ["orifice_width_mm", "moving_mass_kg"]

    plain, heavy = (
        find_free(Bench(Template(AXIS, one, 1), course, 1e-3), names, Wish())
        for one in (SETTINGS, loaded)
    )

    assert plain == names
    assert heavy == ["orifice_width_mm", "load_mass_kg"]


def test_a_stroke_starts_from_the_mean_of_the_rest_before_it(record):
    """Not from one row, whose noise would be in the whole stroke: 28 ms are 7 rows and itself."""
    before = make_course(record, 4e-3).strokes[2]
    measured = record.measured.copy()
    measured[before.rows.start, 1] += 8e5

    after = make_course(replace(record, measured=measured), 4e-3).strokes[2]

    assert after.start[2] - before.start[2] == pytest.approx(1e5, rel=0.01)


def test_a_position_in_inches_is_doubted(record):
    p, options = AXIS.parameters, AXIS.options
    inches = replace(record, measured=record.measured / [25.4, 1.0, 1.0])

    assert check_plausible(record, p, options) == []
    (line,) = check_plausible(inches, p, options)
    assert line.startswith("the position changes by ")
    assert "set-points of up to 85 % the configured valve gives" in line


def test_strokes_of_one_amplitude_are_left_out_together(record):
    bench = Bench(Template(AXIS, SETTINGS, 1), make_course(record, 4e-3), 1e-3)

    folds, notes = choose_folds(bench)

    assert folds == [[2, 3], [4, 5]]  # the smallest opening alone shows the overlap
    assert notes == ()


def test_the_model_that_predicts_best_is_taken():
    def rung(*scores):
        return Rung("", Fit((), np.array([]), 0.0, True), np.array(scores), ())

    far, near, unjudged = rung(9, 8, 9, 8), rung(1, 1.4, 0.9, 1.1), rung()
    assert choose_rung([far, near, unjudged]) == 1
    assert choose_rung([near, far]) == 0
    assert choose_rung([unjudged]) == 0


def test_rows_that_are_finer_serve_the_papers_model_alone():
    """Of a plain machine, a refined model of the plateaus has 14 times the error in speed."""

    def rung(title, score):
        return Rung(title, Fit((), np.array([]), 0.0, True), np.array([score**2]), ())

    assert rung(THE_PAPERS, 0.14).gains_by_rows
    assert not rung(THE_PAPERS, 0.16).gains_by_rows
    assert not rung(WHOLE, 0.14).gains_by_rows
    assert not rung(PLATEAUS, 0.14).gains_by_rows


def test_of_models_that_predict_alike_the_simplest_is_taken():
    unknown = Template(AXIS, SETTINGS, 1).unknown("moving_mass_kg")

    def rung(unknowns, score):
        fit = Fit((unknown,) * unknowns, np.zeros(unknowns), 0.0, True)
        return Rung("", fit, np.full(4, score**2), ())

    assert choose_rung([rung(8, 0.4), rung(2, 0.14), rung(30, 0.05)]) == 1
    assert choose_rung([rung(8, 0.4), rung(2, 0.2), rung(30, 0.05)]) == 2
    assert choose_rung([rung(8, 0.43), rung(30, 0.4)]) == 0  # a tenth is nothing to go by
    assert choose_rung([rung(8, 0.45), rung(30, 0.4)]) == 1


def test_where_nothing_was_left_out_the_simplest_that_fits_is_taken():
    unknown = Template(AXIS, SETTINGS, 1).unknown("moving_mass_kg")

    def rung(unknowns, cost):
        fit = Fit((unknown,) * unknowns, np.zeros(unknowns), cost, True)
        return Rung("", fit, np.array([]), ())

    plateaus = rung(18, 300.0)
    assert choose_rung([plateaus, rung(7, 24.0), rung(29, 172.0), rung(32, 121.0)]) == 1
    assert choose_rung([plateaus, rung(7, 24.0), rung(29, 23.0)]) == 1
    assert choose_rung([plateaus, rung(7, 24.0), rung(29, 2.0)]) == 2


def test_a_bench_keeps_its_dead_volumes_where_an_area_moves():
    """Half the stroke of 10 cm² more is swept more; of what stays, no key is written."""
    template = Template(AXIS, SETTINGS, 1)
    dead, half = template.dead("dead_a"), AXIS.parameters.h * 1e2  # [cm]; h is half the stroke
    area = AXIS.parameters.A_A * 1e4 + 10.0  # [cm²]

    assert template.keys({"viscous_friction_n_s_m": 5.0}) == {"viscous_friction_n_s_m": 5.0}
    found = template.keys({"piston_area_cm2": area})
    assert found.keys() == {"piston_area_cm2", "piston_side_volume_cm3"}
    assert found["piston_side_volume_cm3"] == pytest.approx(dead + area * half)
    assert dead == pytest.approx(AXIS.parameters.V_A0 * 1e6 - (area - 10.0) * half)


def test_no_time_at_all_leaves_what_the_plateaus_show(record):
    """The first answer runs hardly anything. The machine has 23 mm, and 20 mm are configured."""
    found = identify(record, AXIS, SETTINGS, step=5e-4, options=Options(seconds=1e-9))

    assert not found.ladder.is_whole
    assert [rung.title for rung in found.ladder.rungs] == [PLATEAUS]
    assert len(found.ladder.best.errors) == 4  # of six strokes, but for the smallest opening
    assert found.keys["orifice_width_mm"] == pytest.approx(23.0, rel=0.03)
    text = write_bench(found, CONFIG, "run.csv", error_lines(found))
    assert "identified from run.csv" in text
    summary = summarise(found, [])
    for said in ("\n", "\n# "):
        assert f"{said}beyond 85 % opening, the largest recorded, count on " in f"{summary}{text}"
    course = replace(
        found.bench.course, strokes=[make_course(record, 4e-3).strokes[0]._replace(opening=1.0)]
    )
    whole = replace(found, bench=replace(found.bench, course=course))
    assert not any(line.startswith("beyond") for line in error_lines(whole))
    assert "the time was over: this is the best so far" in summary
    for rung in found.ladder.rungs:
        (line,) = [each for each in summary.splitlines() if each.startswith(f"{rung.title:32} ")]
        assert line.endswith("<- taken")
    assert "nan" not in summary
    figure = draw_strokes(found)
    for position, pressures, off, command in np.array(figure.axes).reshape(4, -1).T:
        measured, model = (line.get_ydata() for line in position.lines)
        assert off.lines[-1].get_ydata() == pytest.approx(model - measured, nan_ok=True)  # [mm]
        assert np.nanmax(np.abs(measured)) > 1.0
        assert len(pressures.lines) == 4  # P_A and P_B, record and model
        assert 1.0 < np.abs(command.lines[0].get_ydata()).max() <= 100.0  # [%]


@pytest.mark.long
def test_a_clock_that_ends_leaves_the_best_so_far(record):
    """Once a search has moved: its best point stays, although later ones have no time."""
    runs = 0

    def tick():
        nonlocal runs
        runs += 1

    class Ending(Clock):
        @property
        def is_over(self):
            return runs > 60

    bench = Bench(
        Template(AXIS, SETTINGS, 1),
        make_course(record, 4e-3),
        1e-3,
        clock=Ending(tick=tick),
        has_middles=True,
    )
    ladder = climb(bench, Wish(), lambda _: None)

    assert not ladder.is_whole
    assert ladder.best.title == PLATEAUS
    # The machine has 23 mm; the search starts from 20 mm.
    assert ladder.best.fit.values["orifice_width_mm"] == pytest.approx(23.0, rel=0.03)


@pytest.mark.long
def test_a_machine_of_the_models_kind_is_found(record):
    held = frozenset(
        {
            "bulk_modulus_mpa",
            "moving_mass_kg",
            "spool_natural_frequency_rad_s",
            "internal_leakage_l_min_bar",
            "stiction_n",
            "flow_saturation",
            "stribeck_velocity_mm_s",
            "load_n",
            "dead_a",
            "dead_b",
            "supply_pressure_bar",
            "tank_pressure_bar",
            "piston_area_cm2",
            "rod_side_area_cm2",
            "null_opening_um",
            "land_overlap_pa_mm",
            "land_overlap_at_mm",
            "land_overlap_pb_mm",
            "land_overlap_bt_mm",
            "spool_damping_ratio",
        }
    )
    found = identify(record, AXIS, SETTINGS, step=5e-4, options=Options(Wish(held)))

    values = found.fit.values
    assert values["orifice_width_mm"] == pytest.approx(23.0, rel=5e-3)
    assert values["viscous_friction_n_s_m"] == pytest.approx(2600.0, rel=0.05)
    # Sensors with 2 um and 0.05 bar of noise: a right model predicts far below these limits.
    errors = found.ladder.best.errors
    assert len(errors) == 4
    assert stated_error(errors, "position") < 0.5
    assert stated_error(errors, "pressure") < 0.3
