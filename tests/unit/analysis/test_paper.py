"""The paper's report: verdicts where the answer is known by hand, and the published copy."""

import re
from pathlib import Path

import numpy as np
import pytest

from hil_bench.abilities.analysis.model_statements import (
    Verdict,
    as_double_rod,
    run_paper,
    with_constant_volumes,
)
from hil_bench.abilities.analysis.paper import (
    IMAGES,
    REPORT,
    check_paper,
    paper_studies,
    report_text,
    write_paper,
)
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import FullOrderPlant, PlantOptions, balanced_state

DOCUMENTS = Path(__file__).parents[3] / "docs"


pytestmark = pytest.mark.long  # all runs of the paper


@pytest.fixture(scope="module")
def runs():
    # Six seconds hold one window of the spectra; the published report takes sixty.
    return run_paper(chirp_duration=6.0)


@pytest.fixture(scope="module")
def statements(runs):
    return check_paper(runs)


@pytest.mark.parametrize(
    ("claim", "verdict", "found"),
    [
        # 1200 / 447.43, and atan2(2 * 0.7 * 2.682, 2.682² - 1) = 31.2 degrees
        ("two to three orders", Verdict.FAILS, "ω₀ / ω_c = 2.68. At ω_c the spool lags by 31°"),
        ("unit 1/s", Verdict.FAILS, "m³/(s Pa)"),
        # the factor 1/2 under the root of (14)
        ("are the derivatives of (14)", Verdict.FAILS, "too large by 1.4142"),
        # 1 mm less the dead-zone of 0.3 mm
        ("saturated orifice state", Verdict.FAILS, "z = 0.70 mm; by (2) it saturates at u"),
        # 0.4 mm less the dead-zone of 0.3 mm
        ("close to the dead-zone", Verdict.HOLDS, "z = 0.10 mm, 10 % of α"),
        # Routh: sigma A / m
        ("unstable starting from", Verdict.HOLDS, "0.485 m²/s (0.493"),
        # The mode that a step's factor 1 + s dt stands for: log(1 + s dt) / dt, s = -50 + 444.6j.
        ("fixed step (0.0001)", Verdict.CORRECTED, "0.1117 to 0.0896"),
        # 2 m over the slope of friction, 400 * 900 + 2000 N s/m, is 1.105e-4 s; with what the oil
        # adds to that mode it is 1.106e-4 s
        ("fixed step (0.0001)", Verdict.CORRECTED, "0.0001106 s"),
        # steady velocities of an independent high-accuracy integration: +0.204 and -0.198 m/s
        ("half of the rod", Verdict.HOLDS, "+204.2 and -197.9 mm/s"),
        # A_A / A_B = 5 / 4.7
        ("|Q_A| = |Q_B|", Verdict.CORRECTED, "1.064"),
        # the gain goes with sqrt(P_S - P_L): by sqrt(0.95 / 0.05), which is 12.8 dB
        ("significantly the system gain", Verdict.HOLDS, "12.8 dB"),
        ("velocity patterns", Verdict.CORRECTED, "against ±201.4 mm/s"),
        # 1 / 4.85e-3 m² and half of it
        ("larger Ā can achieve", Verdict.FAILS, "from 206.2 to 103.1"),
        # zeta of (20) over the root of 10
        ("Unlike the mechanical stiffness", Verdict.CORRECTED, "falls to 0.0353"),
        # alpha K sqrt(P_S / 4), K = 0.65 * 0.02 * sqrt(2 / 850), in l/min; sqrt(3) times as much
        # with the load's sign turned alone
        ("symmetrical with respect to both axes", Verdict.CORRECTED, "59.8 l/min at α"),
        ("symmetrical with respect to both axes", Verdict.CORRECTED, "it is -103.6 l/min"),
        # eqs. (19), (20) with C_qp of (22): sigma + C_qp m E 4 / V_t ... by hand at 0.95, 0.05
        ("maximal orifice and load pressure", Verdict.CORRECTED, "11 % at high orifice and low"),
        # tanh leaves a slope at rest, so that no pressure falls below zero where the sign does
        ("argument of the root", Verdict.CORRECTED, "tanh(400 v) in 0"),
        # 90 + atan(2 pi 500 Hz 20 kg / (400 * 900 + 2000 N s/m)) = 99.85 degrees
        ("inherently lower", Verdict.FAILS, "a phase of -100° at 500 Hz"),
        ("anti-phase", Verdict.FAILS, "m s + σ leads by 77° at 70 Hz"),
    ],
)
def test_known_answers_are_found(statements, claim, verdict, found):
    (statement,) = [each for each in statements if claim in each.claim]

    assert statement.verdict is verdict
    assert found in statement.found


def test_nothing_found_is_without_a_number_that_is_one(statements):
    assert len(statements) > 30
    for statement in statements:
        assert not re.search(r"\b(nan|inf)\b", statement.found)


def test_the_published_report_has_these_statements_and_verdicts(statements):
    published = (DOCUMENTS / REPORT).read_text(encoding="utf-8")

    for statement in statements:
        row = f"| {statement.place} | {statement.claim} |".replace(
            "|Q_A| = |Q_B|", r"\|Q_A\| = \|Q_B\|"
        )
        (line,) = [line for line in published.splitlines() if line.startswith(row)]
        assert line.endswith(f"| **{statement.verdict}** |")
    for image in re.findall(r"\]\((.*?)\)", published):
        assert (DOCUMENTS / image).is_file()


def test_low_inputs_leave_the_resonance_asleep_and_friction_is_why(runs):
    high, low = (run.estimate for run in runs.chirps[:2])
    free = runs.frictionless.estimate

    assert high.gain_at(70.0) - high.gain_at(5.0) > 8.0
    assert low.gain_at(70.0) - low.gain_at(5.0) < -15.0
    # Forward Euler's zeta of 0.0896 makes a peak of -20 log10(2 * 0.0896) = 14.9 dB.
    assert free.peak(20.0, 200.0)[1] - free.gain_at(5.0) == pytest.approx(14.9, abs=1.0)


def test_the_averaged_cylinder_is_all_that_tells_both_models_apart(runs):
    rods, single = runs.double_rod, runs.trajectories[1]

    # Once the motion is steady, eq. (15) is exact for a double rod.
    steady = (rods.reduced["time"] > 1.5) & (rods.reduced["time"] < 4.0)
    apart = rods.full_order["P_L"][steady] - rods.reduced["P_L"][steady]
    assert np.abs(apart).max() < 100.0
    apart = single.full_order["P_L"][steady] - single.reduced["P_L"][steady]
    assert np.abs(apart).min() > 2e5


def test_the_variants_change_what_they_say(table_1):
    frozen, rod = with_constant_volumes(table_1), as_double_rod(table_1)

    assert rod.omega_c == pytest.approx(table_1.omega_c)
    assert rod.zeta == pytest.approx(table_1.zeta)
    assert rod.A_A == rod.A_B
    assert rod.V_A0 == rod.V_B0
    state = balanced_state(frozen, x=0.1)
    plant = FullOrderPlant(frozen, options=PlantOptions.paper(), state=state)
    assert plant.state == state  # far beyond that h, and allowed without an end stop


def test_the_report_shows_every_figure(runs):
    text = report_text(runs)
    names = [name for study in paper_studies(runs) for name in study.figures]

    assert names == [f"paper-fig{number}" for number in range(2, 7)]
    for name in names:
        assert f"({IMAGES}/{name}.png)" in text


def test_all_is_written_below_the_directory(runs, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "hil_bench.abilities.analysis.paper.paper_studies", lambda runs: full(runs)[1:2]
    )
    files = write_paper(tmp_path, runs)

    assert files[0] == tmp_path / REPORT
    assert [path.name for path in files[1:]] == [f"paper-fig3.{s}" for s in ("csv", "png", "svg")]
    assert all(path.is_file() for path in files)


full = paper_studies


def test_a_directory_that_cannot_be_written_is_told_before_the_simulation(tmp_path):
    (tmp_path / IMAGES).write_text("in the way")
    with pytest.raises(ConfigError, match="cannot be written: File exists"):
        write_paper(tmp_path)
