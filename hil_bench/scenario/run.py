"""Runs of a scenario on a virtual bench: steps at their ticks, then the judgement.

`prepare` reads a scenario against its bench and refuses what cannot be; `play` does it, as often as
one likes, each time on a fresh bench.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import BenchConfig, FaultConfig, load_config
from hil_bench.bench.fault_points import schedule_faults
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError
from hil_bench.scenario.controllers import CONTROLLERS
from hil_bench.scenario.director import Director, RunPlan
from hil_bench.scenario.driving import Driver, ExampleDriver, FirmwareDriver, NobodyDriver
from hil_bench.scenario.hand import Hand
from hil_bench.scenario.judgement import judge
from hil_bench.scenario.monitor import Monitor
from hil_bench.scenario.recorded import Finding
from hil_bench.scenario.records import FirmwareStep, NmtStep, Scenario, SyncStep
from hil_bench.scenario.resolve import (
    Requirement,
    SetAction,
    TimedAction,
    compile_expectations,
    parameter_values,
    resolve_steps,
)
from hil_bench.scenario.targets import Targets
from hil_bench.scenario.usage import unused_parameters
from hil_bench.scenario.witness import Witness, bench_vocabulary, names_in
from hil_bench.session.recording import NO_RECORDING, RecordingWish
from hil_bench.session.session import Session, open_session
from hil_bench.session.virtual_bench import VirtualBench

_BLOCK = 64  # ticks between two looks at whether a requirement has failed


@dataclass(frozen=True, slots=True)
class PreparedScenario:
    """A scenario that fits its bench.

    Attributes:
        scenario: as loaded.
        config: its bench.
        parameters: the SI value of each parameter.
        actions: its steps.
        requirements: its expectations.
    """

    scenario: Scenario
    config: BenchConfig
    parameters: Mapping[str, float]
    actions: tuple[TimedAction, ...]
    requirements: tuple[Requirement, ...]

    @property
    def last_tick(self) -> int:
        """Number of the last tick of a run."""
        return round(self.scenario.duration * 1e9) // self.config.tick_ns


class PlayOptions(NamedTuple):
    """How to play.

    Attributes:
        stops_at_failure: whether a run ends when the first requirement has failed.
        record: what to record in files.
    """

    stops_at_failure: bool = False
    record: RecordingWish = NO_RECORDING


PLAIN = PlayOptions()


@dataclass(frozen=True, slots=True)
class Run:
    """What a run found.

    Attributes:
        findings: the judgement on each requirement, in the order of the file.
        duration: how long it was [s].
        is_early: whether it ended before the scenario does.
        ending: how the controller ended before the run did; empty where it did not.
    """

    findings: tuple[Finding, ...]
    duration: float
    is_early: bool
    ending: str


def prepare(
    scenario: Scenario,
    given: Mapping[str, float] | None = None,
    *,
    seed: int | None = None,
    tables: Mapping[str, object] | None = None,
) -> PreparedScenario:
    """Return a scenario with its numbers in, checked against its bench.

    Args:
        scenario: as loaded.
        given: values of parameters, in their own units, that win over the file's.
        seed: takes the place of the bench's own.
        tables: tables of the bench's file, nested; their keys win over its own.

    Raises:
        ConfigError: something does not fit; a line a problem.
    """
    bench = scenario.path.parent / scenario.bench if scenario.bench else None
    config = load_config(bench, seed=seed, tables=tables)
    values = parameter_values(scenario, given)
    actions = resolve_steps(scenario, config.tick_ns, values)
    session = open_session(config)
    requirements: tuple[Requirement, ...] = ()
    problems = [
        *_controller_problems(scenario),
        *unused_parameters(scenario),
        *_step_problems(actions, config, session),
    ]
    try:
        requirements = compile_expectations(scenario, bench_vocabulary(config, session, values))
    except ConfigError as error:
        problems.append(str(error))
    if problems:
        raise ConfigError("\n".join(problems))
    return PreparedScenario(scenario, config, values, actions, requirements)


def play(prepared: PreparedScenario, options: PlayOptions = PLAIN) -> Run:
    """Play a scenario on a fresh bench, and judge; a `ControllerError` says that firmware failed.

    Raises:
        ConfigError: a step cannot do what it says.
    """
    config, last_tick = prepared.config, prepared.last_tick
    with (
        VirtualBench(config, recorded_time=0.001, logged_frames=0, record=options.record) as bench,
        _driver(prepared, bench) as driver,
    ):
        session = bench.session
        director = Director(
            _plan(prepared),
            session,
            Targets(config, session),
            Hand(config, session),
            driver.on_firmware,
        )
        names = names_in(each.condition for each in prepared.requirements)
        witness = Witness(config, session, names, last_tick)
        if options.stops_at_failure:
            session.watch(ticks=_Stopper(prepared, witness, director).look)
        session.intercept = director
        ending = driver.drive(director, last_tick)
    if director.problem:
        raise ConfigError(director.problem)
    columns = witness.columns()
    findings = tuple(
        Finding(
            each,
            judge(each.condition, columns, ticks=witness.ticks, tick_ns=config.tick_ns),
        )
        for each in prepared.requirements
    )
    duration = max(witness.ticks - 1, 0) * config.tick_ns * 1e-9
    return Run(findings, duration, witness.ticks <= last_tick, ending)


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


@contextmanager
def _driver(prepared: PreparedScenario, bench: VirtualBench) -> Iterator[Driver]:
    controller = prepared.scenario.controller
    if controller is None:
        yield NobodyDriver(bench)
    elif controller.example:
        yield ExampleDriver(bench, controller.example, prepared.parameters)
    else:
        values = {
            each.name: each.unit.from_si(prepared.parameters[each.name])
            for each in prepared.scenario.parameters
        }
        words = [_filled(word, values) for word in controller.firmware]
        starts = [s.command for s in prepared.scenario.steps if isinstance(s, FirmwareStep)]
        with TemporaryDirectory(prefix="hil-bench-") as directory:
            driver = FirmwareDriver(bench, words, Path(directory), starts[:1])
            try:
                yield driver
            finally:
                driver.close()


def _filled(word: str, values: Mapping[str, float]) -> str:
    for name, value in values.items():
        word = word.replace("{" + name + "}", f"{value:.12g}")
    return word


def _controller_problems(scenario: Scenario) -> Iterator[str]:
    controller = scenario.controller
    if controller is not None and controller.example and controller.example not in CONTROLLERS:
        near = find_nearest(controller.example, CONTROLLERS)
        wrong = f"{quote(controller.example)} is no example; the nearest is {near}"
        yield f"{scenario.path}: controller.example: {wrong}"
    is_firmware = controller is not None and bool(controller.firmware)
    for step in scenario.steps:
        if isinstance(step, FirmwareStep) and not is_firmware:
            yield f"{step.place}: there is no firmware; give it in [controller]"
        if isinstance(step, SyncStep) and is_firmware:
            wrong = "the firmware's SYNC lets bench time pass, so it cannot be switched"
            yield f"{step.place}: {wrong}; kill the firmware instead"


def _step_problems(
    actions: tuple[TimedAction, ...], config: BenchConfig, session: Session
) -> Iterator[str]:
    targets = Targets(config, session)
    spare = build_bench(config)
    for _, action, place in actions:
        try:
            match action:
                case SetAction():
                    target = targets.find(action.target)
                    for value in (action.value, *(value for _, value in action.course)):
                        targets.check(target, value)
                case FaultConfig():
                    schedule_faults(spare.faults, (action,))
                case NmtStep():
                    targets.check_node(action.target)
        except ConfigError as error:
            yield f"{place}: {error}"
