"""The checks of the plant pass for the model as it is, and notice a model that is another."""

import math
from dataclasses import replace

import pytest

from hil_bench.abilities.analysis import closed_forms as subjects
from hil_bench.abilities.analysis.closed_forms import (
    CheckVerdict,
    Subject,
    ValidationCheck,
    closed_form_checks,
    closed_pressures,
    friction,
    held_displacement,
    steady_speed,
)
from hil_bench.abilities.analysis.validation import TABLE_I, published_checks, validate
from hil_bench.plants.hydraulic_cylinder.model import FullOrderPlant, paper_parameters

PAPER = Subject(name="Table I", parameters=paper_parameters())


def failed(checks):
    return {check.name.partition(" at an opening")[0] for check in checks if is_failed(check)}


def is_failed(check):
    return check.verdict is CheckVerdict.FAILED


@pytest.fixture
def with_a_plant_of(monkeypatch):
    """Let the plant have other parameters than the closed forms."""

    def change(**factors):
        def build(parameters, **rest):
            others = {name: factor * getattr(parameters, name) for name, factor in factors.items()}
            return FullOrderPlant(replace(parameters, **others), **rest)

        monkeypatch.setattr(subjects, "FullOrderPlant", build)

    return change


def test_the_model_as_it_is_passes_every_check():
    checks = [*published_checks(PAPER), *closed_form_checks(PAPER)]
    assert {check.verdict for check in checks} == {CheckVerdict.PASSED}
    assert len(checks) >= len(TABLE_I) + 20


@pytest.mark.parametrize(
    ("factors", "names"),
    [  # half a percent, in what each closed form contains
        ({"C_d": 1.005}, {"speed out", "speed back", "Q_A out", "Q_A back"}),
        ({"P_S": 1.005}, {"speed out", "P_A out", "P_B back"}),
        ({"m": 1.005}, {"eigenfrequency of the closed cylinder, viscous friction alone"}),
        ({"E": 1.005}, {"position at rest, closed, under -4.7 kN"}),
        ({"sigma": 1.03}, {"damping ratio of the closed cylinder, viscous friction alone"}),
        ({"alpha": 1.005}, {"orifice state at twice the full opening"}),
        (
            {"V_A0": 1.005},
            {"oil of chamber A that is lost or made, of the oil displaced out and back"},
        ),
        ({"beta": 0.3}, {"speed with the spool inside the dead zone"}),
        ({"omega_0": 1.005}, {"spool 1.65 ms after a step of 0.15 mm"}),
    ],
)
def test_a_plant_with_a_wrong_parameter_fails(with_a_plant_of, factors, names):
    with_a_plant_of(**factors)
    assert names <= failed(closed_form_checks(PAPER))


def test_a_parameter_that_is_not_table_i_fails():
    wrong = replace(paper_parameters(), chi=0.021)
    assert failed(published_checks(replace(PAPER, parameters=wrong))) >= {"parameter chi"}


def test_the_closed_forms_by_hand():
    p = paper_parameters()
    # (13) at 0.1 m/s: 600 + 300 exp(-5^0.8) + 200 N; tanh(40) is 1.
    assert friction(p, 0.1) == pytest.approx(800.0 + 300.0 * math.exp(-(5.0**0.8)), rel=1e-12)
    # Without friction: v = z K sqrt(P_S A_A / (A_A³ + A_B³)), K = 0.65 0.02 sqrt(2 / 850).
    free = replace(p, F_c=0.0, F_s=0.0, sigma=0.0)
    gain = 0.65 * 0.02 * math.sqrt(2.0 / 850.0)
    by_hand = 1e-3 * gain * math.sqrt(5e4 / (1.25e-7 + 1.03823e-7))
    assert steady_speed(free, 1e-3, 1.0) == pytest.approx(by_hand, rel=1e-12)
    # A load balances what the two chambers change by: for a small one, load / stiffness, with
    # E (A_A² / V_A + A_B² / V_B) = 1e8 (2.5e-5 / 1.2e-3 + 2.209e-5 / 1.15e-3) N/m.
    stiffness = 1e8 * (2.5e-5 / 1.2e-3 + 2.209e-5 / 1.15e-3)
    pressures = (4.7e6, 5.0e6)  # P_A A_A = P_B A_B
    x = held_displacement(p, pressures, 1.0)
    assert x == pytest.approx(-1.0 / stiffness, rel=1e-4)
    P_A, P_B = closed_pressures(p, pressures, x)
    assert P_A * p.A_A - P_B * p.A_B == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("found", [1.11, math.nan, math.inf])
def test_what_is_off_by_more_than_the_tolerance_fails(found):
    check = ValidationCheck(
        subject="", name="", unit="-", source="", expected=1.0, found=found, tolerance=0.1
    )
    assert check.verdict is CheckVerdict.FAILED


def test_each_cylinder_of_a_bench_is_checked_with_its_own_parameters(load_bench):
    axes = load_bench("[plant.arm]\nmoving_mass_kg = 80.0\n").axes
    checks = [check for check in validate(axes, 5e-5) if check.subject == "arm"]
    assert failed(checks) == set()
    (swing,) = [check for check in checks if check.name.startswith("eigenfrequency")]
    stiffness = 1e8 * (2.5e-5 / 1.2e-3 + 2.209e-5 / 1.15e-3)
    assert swing.expected == pytest.approx(math.sqrt(stiffness / 80.0), rel=1e-9)


def test_what_has_no_closed_form_says_so(load_bench):
    axes = load_bench('[plant.arm]\nmodel = "reduced"\n').axes
    (check,) = [check for check in validate(axes, 5e-5) if check.subject == "arm"]
    assert check.verdict is CheckVerdict.NOT_APPLICABLE
    assert "full-order" in check.detail
