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

    A test that passes beside a fault that has changed nothing, as one that met no frame, is an
    error.

    Yields:
        The faults.
    """
    found: Faults = bench.faults
    failed = request.session.testsfailed
    yield found
    if found.idle and request.session.testsfailed == failed:
        pytest.fail(f"not exercised: nothing was changed by {', '.join(found.idle)}", pytrace=False)
