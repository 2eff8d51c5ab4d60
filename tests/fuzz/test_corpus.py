"""Each input that the fuzzer has kept is replayed, atheris or not."""

import pytest
from fuzz.__main__ import CORPUS, TARGETS, load


@pytest.mark.parametrize("target", TARGETS)
def test_nothing_kept_breaks_it(target: str) -> None:
    inputs = sorted((CORPUS / target).iterdir())
    assert inputs, f"no corpus for {target}"
    one_input = load(target)
    for path in inputs:
        one_input(path.read_bytes())
