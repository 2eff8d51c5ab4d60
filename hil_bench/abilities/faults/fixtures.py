"""The fixture `faults`: those of the bench of a test."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from hil_bench.abilities.faults.faults import Faults
    from hil_bench.bench.virtual_bench import VirtualBench


@pytest.fixture
def faults(bench: "VirtualBench") -> "Faults":
    """The faults of the bench, as in ``faults.freeze("pressure_a")``."""
    found: Faults = bench.faults
    return found
