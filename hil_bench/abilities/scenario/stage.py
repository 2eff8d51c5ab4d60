"""A scenario on a session: its steps act there, and what its expectations need is taken down."""

from hil_bench.abilities.scenario.director import Director, RunPlan
from hil_bench.abilities.scenario.hand import Hand
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.prepared import PreparedScenario
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.recorded import Finding, Trace, judge_trace
from hil_bench.abilities.scenario.targets import Targets
from hil_bench.abilities.scenario.witness import Witness
from hil_bench.errors import ConfigError
from hil_bench.session.session import Session

_BLOCK = 64  # ticks between two looks at whether a requirement has failed


class Stage:
    """The stage of a scenario: its actions on a session and its view of it.

    Args:
        prepared: the scenario.
        session: of its bench, before the first tick.
        stops_at_failure: whether the run is over when a requirement has failed.

    Attributes:
        director: does the steps; it knows when the run is over.
        witness: takes down what the expectations need.
    """

    def __init__(
        self,
        prepared: PreparedScenario,
        session: Session,
        *,
        stops_at_failure: bool = False,
    ) -> None:
        config = prepared.config
        self._prepared = prepared
        targets, hand = Targets(config, session), Hand(config, session)
        self.director = Director(_plan(prepared), session, targets, hand)
        names = names_in(each.condition for each in prepared.requirements)
        self.witness = Witness(config, session, names, prepared.last_tick)
        if stops_at_failure:
            session.watch(ticks=_Stopper(prepared, self.witness, self.director).look)
        session.intercept = self.director
        if session.bench.medium is not None:
            session.bench.medium.is_direct = False  # the director sees frames before the bus does

    def adopt(self, prepared: PreparedScenario) -> None:
        """Go on as another run of the scenario, which was the same up to now.

        Args:
            prepared: that run; its expectations name the same signals, states and events.
        """
        self._prepared = prepared
        self.director.adopt(prepared.actions)

    def end(self) -> None:
        """Let the run be over."""
        self.director.is_over = True

    def judge(self) -> tuple[Finding, ...]:
        """Return the judgement on each requirement, by the ticks so far; the others are unknown.

        Raises:
            ConfigError: a step could not act.
        """
        if self.director.problem:
            raise ConfigError(self.director.problem)
        witness, planned = self.witness, self._prepared.last_tick + 1
        trace = Trace(witness.columns(), witness.ticks, self._prepared.config.tick_ns, planned)
        return tuple(judge_trace(each, trace) for each in self._prepared.requirements)


class _Stopper:
    """Ends a run when a requirement has failed."""

    def __init__(self, prepared: PreparedScenario, witness: Witness, director: Director) -> None:
        tick_ns = prepared.config.tick_ns
        self._monitors = [Monitor(each.condition, tick_ns) for each in prepared.requirements]
        self._witness, self._director = witness, director
        self._seen = 0

    def look(self, _now: int) -> None:
        """Judge the ticks since the last look, where they are enough."""
        ticks = self._witness.ticks
        if ticks - self._seen < _BLOCK or self._director.is_over:
            return
        columns = self._witness.columns(self._seen)
        for monitor in self._monitors:
            monitor.push(columns, ticks - self._seen)
        self._seen = ticks
        self._director.is_over = any(monitor.is_failed for monitor in self._monitors)


def _plan(prepared: PreparedScenario) -> RunPlan:
    sync_ticks = 0 if prepared.scenario.controller else prepared.config.ticks_per_sync
    return RunPlan(prepared.actions, prepared.config.tick_ns, prepared.last_tick, sync_ticks)
