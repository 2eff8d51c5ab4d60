"""What a study leaves: text, JSON values, CSV, PNG and SVG, the same bytes each time."""

import math

import numpy as np
import pytest

from hil_bench import errors
from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.study import (
    Fact,
    Study,
    flow_pressure_study,
    linearisation_study,
    make_table,
    operating_points_study,
    root_locus_study,
    write_study,
)
from hil_bench.errors import ConfigError, require_extra
from hil_bench.outside.recording.channels import Channel
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions


@pytest.mark.parametrize(
    ("value", "text", "plain"),
    [
        (0.5, "0.5", 0.5),
        (-50.0 + 444.6j, "-50 + 444.6j", [-50.0, 444.6]),
        (-50.0 - 444.6j, "-50 - 444.6j", [-50.0, -444.6]),
        (2.0 + 0.5j, "2 + 0.5j", [2.0, 0.5]),
        (-3.0 + 0.0j, "-3", [-3.0, 0.0]),
        (math.inf, "inf", None),
    ],
)
def test_a_fact_is_read_by_people_and_by_programs(value, text, plain):
    fact = Fact("something", value, "-")

    assert fact.text == text
    assert fact.plain == plain


def test_a_table_is_written_with_names_units_and_all_digits(tmp_path):
    table = make_table({Channel("a", "m"): [0.1, 1.0 / 3.0], Channel("b", "-"): [1.0, 2.0]})
    write_study(Study(title="", facts=[], tables={"name": table}, figures={}), tmp_path)

    lines = (tmp_path / "name.csv").read_text(encoding="utf-8").splitlines()
    assert lines == ["a,b", "m,-", "0.1,1.0", "0.3333333333333333,2.0"]


@pytest.mark.long
def test_the_same_study_writes_the_same_bytes(table_1, tmp_path):
    written = []
    for name in ("once", "again"):
        directory = tmp_path / name
        directory.mkdir()
        for study in (root_locus_study(table_1), operating_points_study(table_1)):
            write_study(study, directory)
        written.append({path.name: path.read_bytes() for path in directory.iterdir()})

    assert written[0] == written[1]
    stems = ("root-locus", "frequency-response-linear")
    assert written[0].keys() == {
        f"{stem}.{suffix}" for stem in stems for suffix in ("csv", "png", "svg")
    }
    for content in written[0].values():
        assert b"matplotlib.org" not in content
        assert b"<dc:date>" not in content


def test_a_figure_that_cannot_be_written_is_one_line(table_1, tmp_path):
    (tmp_path / "root-locus.png").mkdir()
    with pytest.raises(ConfigError, match=r"root-locus\.png: cannot be written: Is a directory"):
        write_study(root_locus_study(table_1), tmp_path)


def test_the_facts_of_a_linearisation_are_those_of_the_closed_forms(table_1):
    point = find_operating_point(table_1, velocity=0.1)
    study = linearisation_study(table_1, point, PlantOptions.paper())
    facts = {fact.name: fact.value for fact in study.facts}

    # sqrt(E / m) of Table I, eqs. (19) and (20), and its share of 2 pi
    rates = {fact.unit: fact.value for fact in study.facts if "omega_c (19)" in fact.name}
    assert rates["rad/s"] == pytest.approx(447.43, abs=0.005)
    assert rates["Hz"] == pytest.approx(447.43 / 6.283185, abs=0.001)
    assert facts["reduced: damping ratio zeta (20)"] == pytest.approx(0.11175, abs=0.000005)

    # Q_L = A v with A = 4.85e-3 m², v = 0.1 m/s; K from eq. (7): C_q = Q_L / z in steady motion of
    # the reduced model, whose z is not quite the full model's.
    assert facts["reduced: flow gain C_q (21), printed"] == pytest.approx(
        math.sqrt(2.0) * facts["reduced: flow gain C_q (21), consistent"].real
    )
    assert facts["reduced: flow gain C_q (21), consistent"] == pytest.approx(
        4.85e-4 / facts["full-order: orifice state"].real, rel=0.02
    )


def test_the_facts_of_flow_over_pressure_are_those_of_eq_14(table_1):
    facts = {fact.name: fact.value for fact in flow_pressure_study(table_1).facts}

    # Q_L = z K sqrt((P_S - P_L) / 2), fully open at z = 1 mm
    assert facts["orifice state, fully open"] == pytest.approx(1e-3)
    assert facts["load flow there, no load"] == pytest.approx(
        1e-3 * table_1.K * math.sqrt(table_1.P_S / 2.0)
    )
    assert facts["load pressure without flow"] == pytest.approx(table_1.P_S)


def test_the_linearisation_of_a_closed_valve_has_no_response_to_draw(table_1, tmp_path):
    point = find_operating_point(table_1, velocity=0.0)
    study = linearisation_study(table_1, point, PlantOptions.paper())
    write_study(study, tmp_path)

    names = study.tables["linearisation"].dtype.names
    assert names is not None
    assert not [name for name in names if name.startswith("full-order")]
    assert np.isfinite(study.tables["linearisation"]["frequency"]).all()


def test_the_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr(errors.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(ConfigError) as caught:
        require_extra("scipy", "a frequency response")

    assert str(caught.value) == (
        "a frequency response needs scipy; install it with: pip install 'hil-bench[analysis]'"
    )
