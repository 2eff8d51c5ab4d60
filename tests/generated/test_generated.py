"""A few generated files of each cheap dialect; the program of this folder plays many."""

import tempfile
from pathlib import Path

import pytest
from generated.dialects import DIALECTS, Dialect
from generated.play import live
from generated.seeds import lay_out
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

LIVES = 4
VERBS = {
    "bench": "check",
    "network": "boot",
    "requirements": "judge",
    "register map": "registers",
    "columns": "identify",
    "scenario sheet": "scenario",
}
CHEAP = [form for form in DIALECTS if form.name in VERBS]


@pytest.mark.parametrize("form", CHEAP, ids=lambda form: form.name)
def test_no_verb_breaks_on_a_generated_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: Dialect
) -> None:
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    monkeypatch.chdir(tmp_path)
    lay_out(tmp_path)

    @seed(1)
    @settings(
        max_examples=LIVES,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def play(source: st.DataObject) -> None:
        for result, text in live(source.draw, tmp_path, form, VERBS[form.name]):
            assert not result.wrong, text

    play()
