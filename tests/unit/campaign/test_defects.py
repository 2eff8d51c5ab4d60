"""The seeded defects have a place in the code as it is, and their scenarios fit it."""

import importlib
import tomllib
from pathlib import Path

import pytest
from support.documents import ROOT

from hil_bench.abilities.campaign.plan import space_of
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import prepare

FOLDER = ROOT / "benchmarks" / "defects"
SOURCES = {"py": ROOT / "drivers" / "hil_drivers", "c": ROOT / "examples" / "firmware"}
DEFECTS = tomllib.loads((FOLDER / "defects.toml").read_text(encoding="utf-8"))["defect"]


def test_there_are_twenty_each_described():
    assert len({each["id"] for each in DEFECTS}) == 20
    assert all(each["what"].endswith(".") for each in DEFECTS)


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda each: each["id"])
def test_a_defect_changes_one_place(defect):
    text = (SOURCES[defect["language"]] / defect["file"]).read_text(encoding="utf-8")
    assert text.count(defect["old"]) == 1
    changed = text.replace(defect["old"], defect["new"])
    if Path(defect["file"]).suffix == ".py":
        compile(changed, defect["file"], "exec")


@pytest.mark.parametrize("name", ["python", "firmware"])
def test_their_scenarios_can_be_played(name):
    scenario = load_scenario(FOLDER / f"{name}.scenario.toml")
    assert prepare(scenario).requirements
    assert space_of(scenario)


@pytest.mark.long  # a search, and tens of runs that make its failures small
def test_a_sound_controller_passes_a_failure_made_small(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    benchmark = importlib.import_module("defects")
    (defect,) = (each for each in benchmark.load_defects() if each.id == "coarse_grid")
    found, wrong = benchmark.false_counterexamples(defect, runs=8, seed=0)
    assert found
    assert wrong == []
