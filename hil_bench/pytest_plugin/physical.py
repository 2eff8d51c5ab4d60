"""The `bench` of a test on a physical bus: time passes, and nothing can be looked into."""

import time
from collections.abc import Callable
from operator import methodcaller
from typing import NoReturn

import pytest

from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import HilBenchError, WaitTimeoutError

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)

LOOK = 0.001
"""Time between two looks at a condition [s]."""


class PhysicalBench:
    """The part of a `VirtualBench` that hardware has too: its time; anything else skips the test.

    Args:
        config: the bench's configuration.

    Attributes:
        config: as passed in.
        pump: takes what arrives on the bus for some seconds; drivers put their network's here.
    """

    def __init__(self, config: BenchConfig) -> None:
        self.config = config
        self.pump: Callable[[float], None] = time.sleep
        self._start = time.monotonic()

    def now(self) -> float:
        """Return the time since the test began [s]."""
        return time.monotonic() - self._start

    def run(self, duration: float) -> None:
        """Let time pass [s]."""
        self.pump(duration)

    def run_until(self, condition: Callable[[], bool], *, timeout: float) -> float:
        """Let time pass until a condition holds; see `VirtualBench.run_until`.

        Raises:
            WaitTimeoutError: it did not hold in time.
        """
        start = self.now()
        while not condition():
            if self.now() - start >= timeout:
                raise WaitTimeoutError(f"condition not met within {timeout:g} s")
            self.pump(LOOK)
        return self.now() - start

    def __getattr__(self, name: str) -> NoReturn:
        pytest.skip(f"bench.{name} needs the virtual bench, which --hil-interface turns off")
