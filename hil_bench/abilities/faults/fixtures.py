"""The fixture `faults`, and the look at whether the faults of a test have changed anything."""

from collections.abc import Generator
from functools import partial
from typing import TYPE_CHECKING

import pytest

from hil_bench.abilities.common.pytest_options import BENCH

if TYPE_CHECKING:
    from hil_bench.abilities.faults.faults import Faults
    from hil_bench.bench.virtual_bench import VirtualBench


@pytest.fixture
def faults(bench: "VirtualBench") -> "Faults":
    """The faults of the bench, as in ``faults.freeze("pressure_a")``."""
    found: Faults = bench.faults
    return found


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Let a test that passes beside a fault that has changed nothing be an error.

    So is one beside a fault of its own that never began.
    """
    result = yield
    bench = item.stash.get(BENCH, None)
    if bench is not None:
        found: Faults = bench.faults
        late = [each for each in found.pending if each not in found.of_file]
        if idle := [*found.idle, *(f"{each.kind} {each.target}" for each in late)]:
            said = f"not exercised: nothing was changed by {', '.join(idle)}"
            item.addfinalizer(partial(pytest.fail, said, pytrace=False))
    return result
