"""The documents show what a pack says."""

import pytest
from support.documents import ROOT

from hil_bench.devices.valve_408 import POSITION, PRESSURE, PRESSURE_AND_FLOW, SPOOL
from hil_bench.machine.conformance.evidence.texts import classification, known_defects
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS, SHARED_KEYS


@pytest.mark.parametrize("defect", known_defects(), ids=lambda defect: defect["id"])
def test_the_documents_show_each_known_defect(defect):
    cells = [defect[key] for key in ("id", "subject", "text", "consequence", "remedy")]
    lines = (ROOT / "docs" / "known-defects.md").read_text(encoding="utf-8").splitlines()
    assert f"| {' | '.join(cells)} |" in lines


def test_the_documents_show_no_other_defect():
    text = (ROOT / "docs" / "known-defects.md").read_text(encoding="utf-8")
    assert text.count("| KD-") == len(known_defects())


def test_the_template_says_what_it_is_not_and_leaves_room():
    notes = classification()
    assert any("not a certificate" in line for line in notes["is_not"])
    assert all(note["to_fill_in"] for note in notes["note"])
    standards = {note["standard"].split(":")[0] for note in notes["note"]}
    assert {"ISO 26262-8", "IEC 61508-3"} <= standards


def heats():
    """Oil changes its temperature by the tank of a supply alone; no wall or chamber has its own."""
    names = {key.name for key in AXIS_KEYS}
    assert "tank_volume_l" not in names
    assert {key.name for key in SHARED_KEYS} >= {"tank_volume_l"}


def refuses_control_modes():
    assert {7, 13, 14}.isdisjoint({SPOOL, POSITION, PRESSURE, PRESSURE_AND_FLOW})


CHECKS = {"KD-2": heats, "KD-5": refuses_control_modes}
"""Each fails when its defect is gone; the other entries have none yet."""


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_a_known_defect_is_still_there(check):
    check()
