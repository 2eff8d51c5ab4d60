"""The documents show what a pack says."""

import pytest
from support.documents import ROOT

from hil_bench.abilities.evidence.content import classification, known_defects


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
