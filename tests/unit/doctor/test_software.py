"""The plant's kernel, as it was built, in the words of `hil-bench doctor`."""

import pytest

from hil_bench.abilities.doctor import verbs
from hil_bench.abilities.doctor.machine import Verdict
from hil_bench.plants.hydraulic_cylinder.model.machine_code import MachineCode


@pytest.mark.parametrize(
    ("code", "has_numba", "verdict", "advice"),
    [
        (MachineCode(bind=lambda *_: None), False, Verdict.GOOD, ""),
        (MachineCode(refusal="of other sources"), True, Verdict.HINT, "each start imports Numba"),
        (MachineCode(), False, Verdict.HINT, "the plant takes 57 us of a tick in place of 2"),
    ],
)
def test_a_kernel_that_costs_time_is_a_hint(monkeypatch, code, has_numba, verdict, advice):
    monkeypatch.setattr(verbs, "find_machine_code", lambda: code)
    monkeypatch.setattr(verbs, "IS_COMPILED", has_numba)
    (item,) = [each for each in verbs.examine_software().findings if each.name == "plant kernel"]
    assert item.verdict is verdict
    assert advice in item.advice
