"""A fixture for pytest: how long the first axis of the bench takes for half a swing."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from hil_bench import VirtualBench


@pytest.fixture
def half_swing(bench: "VirtualBench") -> Callable[[], float]:
    """Return a function that waits for two turns of the first axis: the time between them [s]."""
    speed = f"{bench.config.first_axis.name}.speed"

    def turns() -> float:
        last = bench.values.get(speed, 0.0)

        def has_turned() -> bool:
            nonlocal last
            before, last = last, bench.values.get(speed, 0.0)
            return before * last < 0.0

        return bench.run_until(has_turned, timeout=10.0)

    def measure() -> float:
        turns()
        return turns()

    return measure
