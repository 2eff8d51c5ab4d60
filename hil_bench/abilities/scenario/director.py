"""Does the steps of a scenario, each at the start of its tick."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from hil_bench.abilities.controllers.power import ONLY
from hil_bench.abilities.scenario.hand import Hand
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, SyncStep
from hil_bench.abilities.scenario.resolve import SetAction, TimedAction
from hil_bench.abilities.scenario.targets import Target, Targets, ValveTarget
from hil_bench.bench.configuration import FaultConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.j1939.auxiliary_valve import PERIOD
from hil_bench.session.commands import BeginFault, Command
from hil_bench.session.lockstep import SYNC_COB_ID
from hil_bench.session.session import Session

if TYPE_CHECKING:
    from concurrent.futures import Future


class RunPlan(NamedTuple):
    """The plan of a run.

    Attributes:
        actions: in the order of time.
        tick_ns: time between two ticks [ns].
        last_tick: number of the last tick.
        sync_ticks: ticks from SYNC to SYNC, where the scenario itself sends it; else 0.
    """

    actions: tuple[TimedAction, ...]
    tick_ns: int
    last_tick: int
    sync_ticks: int = 0


class Move(NamedTuple):
    """A value that is on its way.

    Attributes:
        target: whose value.
        points: ticks and values, straight lines between.
    """

    target: Target
    points: tuple[tuple[int, float], ...]

    def at(self, tick: int) -> float:
        """Return the value at a tick, the first one or later; behind the last one, its value."""
        for (start, low), (end, high) in pairwise(self.points):
            if start <= tick < end:
                return low + (high - low) * (tick - start) / (end - start)
        return self.points[-1][1]


class Director:
    """The steps of a run; it is the `intercept` of a session.

    Args:
        plan: what to do.
        session: on which bench.
        targets: what may be set there.
        hand: sets it.

    Attributes:
        is_over: whether the run has come to its end.
        problem: what a step could not do; empty where all went well.
    """

    def __init__(
        self,
        plan: RunPlan,
        session: Session,
        targets: Targets,
        hand: Hand,
    ) -> None:
        self.is_over = False
        self.problem = ""
        self._plan, self._session, self._hand = plan, session, hand
        self._targets = targets
        self._waiting = list(reversed(plan.actions))
        self._courses: dict[str, Move] = {}
        self._values: dict[str, float] = {}
        self._repeated: dict[str, ValveTarget] = {}
        self._repeats_at: dict[str, int] = {}
        self._tick = 0
        self._sends_sync, self._passes_sync = False, True
        self._answers: list[tuple[str, Future[Any]]] = []
        session.watch(ticks=self._settle)

    def adopt(self, actions: Sequence[TimedAction]) -> None:
        """Go on with the actions of another run, whose first ones are those that have begun."""
        done = self.done
        self._plan = self._plan._replace(actions=tuple(actions))
        self._waiting = list(reversed(actions[done:]))

    @property
    def done(self) -> int:
        """The number of actions that have begun, the first ones of the plan."""
        return len(self._plan.actions) - len(self._waiting)

    def __call__(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Do what is due; return the frames of the controller, and behind them those of steps."""
        tick = self._tick = now // self._plan.tick_ns
        if self.is_over or tick > self._plan.last_tick:
            self.is_over = True
            return frames
        own = list(self._due(tick))
        if self._sends_sync and tick % self._plan.sync_ticks == 0:
            own.append(Frame(SYNC_COB_ID))
        if not self._passes_sync:
            frames = [frame for frame in frames if frame.can_id != SYNC_COB_ID]
        return [*frames, *own] if own else frames

    def _due(self, tick: int) -> Iterator[Frame]:
        while self._waiting and self._waiting[-1].tick <= tick:
            yield from self._act(self._waiting.pop(), tick)
        for name, course in list(self._courses.items()):
            if tick < course.points[0][0]:
                continue
            yield from self._set(name, course.target, course.at(tick))
            if tick >= course.points[-1][0]:
                del self._courses[name]
        for name, target in self._repeated.items():
            if tick >= self._repeats_at[name]:
                yield from self._set(name, target, self._values[name])

    def _act(self, timed: TimedAction, tick: int) -> Iterator[Frame]:
        action = timed.action
        match action:
            case SetAction():
                self._courses[action.target] = self._course(action, tick)
            case FaultConfig():
                times = {} if action.duration is None else {"duration": action.duration}
                begin = BeginFault(action.kind, action.target, {**action.values, **times})
                self._put(timed.place, begin)
            case NmtStep():
                yield from self._hand.command(action)
            case SyncStep() if self._plan.sync_ticks:
                self._sends_sync = action.is_on
            case SyncStep():
                self._passes_sync = action.is_on
            case FirmwareStep():
                self._switch(action)

    def _switch(self, step: FirmwareStep) -> None:
        """Switch a controller: the one that is named, the scenario's own, or the bench's only."""
        switches = self._session.switches
        name = step.target or (ONLY if ONLY in switches else next(iter(switches)))
        switches[name](step.command)

    def _course(self, action: SetAction, tick: int) -> Move:
        target = self._targets.find(action.target)
        start = self._values.get(action.target, self._hand.present(target))
        return Move(target, action.points(tick, start))

    def _set(self, name: str, target: Target, value: float) -> Iterator[Frame]:
        self._values[name] = value
        done = self._hand.set(target, value)
        if isinstance(target, ValveTarget):
            self._repeated[name] = target
            self._repeats_at[name] = self._tick + -(-PERIOD // self._plan.tick_ns)
        if isinstance(done, Frame):
            yield done
        else:
            self._put(name, done)

    def _put(self, place: str, command: Command) -> None:
        self._answers.append((place, self._session.door.put(command)))

    def _settle(self, _now: int) -> None:
        """See whether all commands of the tick could act; end the run where one could not."""
        for place, answer in self._answers:
            error = answer.exception(0.0)
            if error is not None and not self.problem:
                self.problem, self.is_over = f"{place}: {error}", True
        self._answers.clear()
