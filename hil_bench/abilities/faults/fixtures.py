"""The fixture `faults`: those of the bench of a test."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from hil_bench.abilities.faults.faults import Faults
    from hil_bench.bench.virtual_bench import VirtualBench


@pytest.fixture
def faults(bench: "VirtualBench", request: pytest.FixtureRequest) -> Iterator["Faults"]:
    """The faults of the bench, as in ``faults.freeze("pressure_a")``.

    A test that passes beside a fault of its own that has changed nothing, as one that met no
    frame, or that never began, is an error.

    Yields:
        The faults.
    """
    found: Faults = bench.faults
    before, failed = found.pending, request.session.testsfailed
    yield found
    late = [f"{each.kind} {each.target}" for each in found.pending if each not in before]
    if (found.idle or late) and request.session.testsfailed == failed:
        idle = ", ".join((*found.idle, *late))
        pytest.fail(f"not exercised: nothing was changed by {idle}", pytrace=False)
