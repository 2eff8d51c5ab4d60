"""Which manoeuvre tells more: within its bounds, and as much as it says."""

from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt
import pytest

from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.choosing import Design, Designer
from hil_bench.abilities.identification.design.course import shorten_course
from hil_bench.abilities.identification.design.foresight import Foresight
from hil_bench.abilities.identification.design.report import design_to_json, summarise_design
from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.abilities.identification.fit import Bench, search
from hil_bench.abilities.identification.machine import Template
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.bench.configuration import load_config
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

AXIS = cast("CylinderConfig", load_config(None).first_axis)
SETTINGS = {
    one.key.name: one for one in load_config(None).settings if one.table == f"plant.{AXIS.name}"
}
WIDTH, OPENING = "orifice_width_mm", "orifice_full_opening_mm"
COULOMB, MASS = "coulomb_friction_n", "moving_mass_kg"
NOISE = np.array([2e-6, 5e3, 5e3])
LIMITS = Limits(position=(-0.05, 0.05), speed=0.2, pressure=(-1e5, 1e7), time=60.0)

Values = npt.NDArray[np.float64]


def twin_of(**changes: float) -> Twin:
    """Return a twin of the built-in bench, with a coarse step that makes it quick."""
    parameters = replace(paper_parameters(), **changes)
    return Twin(
        axis="axis1",
        parameters=parameters,
        options=AXIS.options,
        step=2.5e-4,
        interval=2e-3,
        full_opening=parameters.full_opening,
        noise=NOISE,
    )


def foresight_of(*names: str, **changes: float) -> Foresight:
    return Foresight(twin_of(**changes), Template(AXIS, SETTINGS, 1), names)


@pytest.fixture(scope="module")
def design() -> Design:
    bounds = Bounds.of(AXIS, LIMITS)
    return Designer(foresight_of(WIDTH, OPENING, COULOMB, MASS), bounds).design(8.0)


@pytest.mark.long
def test_a_fit_scatters_as_was_foreseen(design: Design) -> None:
    """The machine differs from the twin by a tenth, which changes the slopes by about as much."""
    machine = twin_of(w=0.022, F_c=540.0, m=22.0)
    record = machine.record(design.setpoints, machine.run(design.setpoints, design.start))
    noise = np.random.default_rng(4).standard_normal(record.measured.shape)
    noisy = replace(record, measured=record.measured + NOISE * noise)
    template = Template(AXIS, SETTINGS, 1)
    bench = Bench(template, make_course(noisy, noisy.interval), machine.step, NOISE)
    unknowns = [template.unknown(name) for name in (WIDTH, COULOMB, MASS)]

    found = search(bench, unknowns, np.zeros(3), 15).values

    true = {WIDTH: 22.0, COULOMB: 540.0, MASS: 22.0}
    for outlook in design.outlooks:
        if outlook.name in true:
            assert outlook.is_told_after
            assert abs(found[outlook.name] - true[outlook.name]) < 5.0 * outlook.after


@pytest.mark.long
def test_what_no_setpoint_reaches_is_not_promised(design: Design) -> None:
    """The full opening needs 735 mm/s on this axis, and 200 mm/s are allowed."""
    outlooks = {one.name: one for one in design.outlooks}

    assert not outlooks[OPENING].is_told_after
    assert all(outlooks[name].is_told_after for name in (WIDTH, COULOMB, MASS))
    assert "not identifiable even then: orifice_full_opening_mm" in summarise_design(design)


@pytest.mark.long
def test_the_motion_stays_within_the_limits(design: Design) -> None:
    x, v = design.states[:, 0], design.states[:, 1]

    assert -0.05 < x.min() < x.max() < 0.05
    assert 0.05 < np.abs(v).max() < 0.2
    assert design.duration <= 8.0 + 0.31  # and the rest at its end
    assert not any("100 %" in one.name for one in design.ranking)


@pytest.mark.long
def test_programs_read_the_keys_of_bench_toml(design: Design) -> None:
    content = design_to_json(design)

    mass = content["parameters"]["moving_mass_kg"]
    assert mass["value"] == 20.0
    assert mass["standard_deviation_today"] == pytest.approx(10.0, rel=1e-3)  # half of 20 kg
    assert mass["standard_deviation_after"] < 1.0
    assert content["manoeuvres"][0]["at_s"] == 0.3


def test_information_of_two_runs_adds_up() -> None:
    """The pieces of a manoeuvre that comes twice say twice as much, apart from where they begin."""
    foresight = foresight_of(WIDTH, MASS)
    steps = np.repeat([0.0, 0.5, -0.5] * 6, 50)
    once, twice = steps, np.concatenate([steps, steps])

    first, second = (
        foresight.reduce(foresight.information(each, foresight.twin.run(each, 0.0)))
        for each in (once, twice)
    )

    assert np.diag(second) == pytest.approx(2.0 * np.diag(first), rel=0.15)


def test_information_goes_by_the_noise() -> None:
    foresight = foresight_of(WIDTH, MASS)
    quiet = replace(foresight, twin=replace(foresight.twin, noise=0.5 * NOISE))
    steps = np.repeat([0.0, 0.5, -0.5] * 6, 50)
    states = foresight.twin.run(steps, 0.0)

    loud, soft = (each.information(steps, states) for each in (foresight, quiet))

    # Half the noise is four times the information; the starts' own spreads go by the noise, too.
    assert soft == pytest.approx(4.0 * loud, rel=1e-2, abs=1e-3 * np.abs(soft).max())


def test_limits_that_allow_nothing_are_named() -> None:
    tight = replace(LIMITS, speed=1e-3)

    with pytest.raises(ConfigError, match="mostly that of speed; give wider"):
        Designer(foresight_of(WIDTH), Bounds.of(AXIS, tight)).design(10.0)


def test_the_limit_named_is_that_which_most_manoeuvres_leave(monkeypatch) -> None:
    designer = Designer(foresight_of(WIDTH), Bounds.of(AXIS, LIMITS))
    refused = {"position": 2, "pressure": 5, "speed": 1}
    monkeypatch.setattr(Designer, "_candidates", lambda _: ([], refused))
    with pytest.raises(ConfigError, match=r"each of the 8 .* mostly that of pressure; give wider"):
        designer.design(10.0)


@pytest.mark.parametrize(
    ("state", "bound"),
    [
        ((0.0, 0.0, 5e6, 5e6), ""),
        ((0.046, 0.0, 5e6, 5e6), "position"),
        ((0.0, -0.19, 5e6, 5e6), "speed"),
        ((0.0, 0.0, 5e6, 1.1e7), "pressure"),
    ],
)
def test_a_tenth_of_the_limits_stays_free(state: tuple[float, ...], bound: str) -> None:
    assert Bounds.of(AXIS, LIMITS).leaves(np.array([state])) == bound


def test_without_a_plan_the_stroke_limits() -> None:
    bounds = Bounds.of(AXIS, None)

    assert bounds.position == pytest.approx((-0.16, 0.16))  # of 400 mm
    assert bounds.leaves(np.array([[0.0, 10.0, 5e6, 5e6]])) == ""


def test_the_course_leads_through_every_setpoint() -> None:
    steps = np.repeat([0.0, 0.4, -0.4], 40)
    setpoints = np.concatenate([steps, np.linspace(0.0, 0.5, 100), 0.3 * np.sin(np.arange(80.0))])

    course = shorten_course(setpoints, 2e-3)

    times, values = np.array(course).T
    assert np.interp(2e-3 * np.arange(len(setpoints)), times, values) == pytest.approx(
        setpoints, abs=1e-5
    )
    assert len(course) < 100  # of 300 rows: only the sine needs one each
