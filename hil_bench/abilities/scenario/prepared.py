"""A scenario that is ready to be played."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from hil_bench.abilities.scenario.records import Scenario, ticks_of
from hil_bench.abilities.scenario.resolve import Requirement, TimedAction
from hil_bench.bench.configuration import BenchConfig
from hil_bench.session.session import Session


@dataclass(frozen=True, slots=True)
class PreparedScenario:
    """A scenario that fits its bench.

    Attributes:
        scenario: as loaded.
        config: its bench.
        parameters: the SI value of each parameter.
        actions: its steps.
        requirements: its expectations.
        sessions: the one that it was checked on, for the first run; empty unless asked for.
    """

    scenario: Scenario
    config: BenchConfig
    parameters: Mapping[str, float]
    actions: tuple[TimedAction, ...]
    requirements: tuple[Requirement, ...]
    sessions: list[Session] = field(default_factory=list, compare=False, repr=False)

    @property
    def last_tick(self) -> int:
        """Number of the last tick of a run."""
        return ticks_of(self.scenario.duration, self.config.tick_ns) - 1
