"""Runs of a scenario on a virtual bench: steps at their ticks, then the judgement.

`prepare` reads a scenario against its bench and refuses what cannot be; `play` does it, as often as
one likes, each time on a fresh bench.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeGuard

from hil_bench.abilities.common.files import scratch_folder
from hil_bench.abilities.controllers.desk import ControllerConfig, Desks
from hil_bench.abilities.controllers.kinds import Chosen, read_controller
from hil_bench.abilities.controllers.power import ONLY, Power
from hil_bench.abilities.controllers.process.kind import KIND as PROCESS
from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.controllers.python.kind import KIND as PYTHON
from hil_bench.abilities.controllers.section import ControllersConfig, config_of
from hil_bench.abilities.faults.building import schedule_faults
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.faults.section import FaultsPart
from hil_bench.abilities.recording.report import RecordingWish
from hil_bench.abilities.scenario import resolve
from hil_bench.abilities.scenario.judgement import MOST_FRAMES, Evidence
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, Scenario, Step, SyncStep
from hil_bench.abilities.scenario.stage import Director, Stage
from hil_bench.abilities.scenario.targets import Targets
from hil_bench.abilities.scenario.usage import MANUAL, idle_steps, usage_problems
from hil_bench.abilities.scenario.witness import bench_vocabulary
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.bench.events import event_spans
from hil_bench.bench.session import Session, open_session
from hil_bench.bench.virtual_bench import FrameReader, VirtualBench
from hil_bench.config.settings import Problems
from hil_bench.config.values import find_nearest, quote
from hil_bench.devices.kinds.registry import VALVE
from hil_bench.errors import ConfigError, ControllerError

# Controllers of a run, and its time, which the runner lets pass.

_MOST_BEHIND = 10_000_000_000
"""Time behind a run [ns] that a controller has to say why it had not begun its work."""

_MUTE = "the program has sent no frame"
_SENT_BY_EXAMPLE = ("spool_setpoint", "0x6300.01", "0x6040")
"""Targets that an example sends too as it enables a valve."""


def controller_of(
    scenario: Scenario, config: BenchConfig, parameters: Mapping[str, float]
) -> ControllerConfig | None:
    """Return the controller of a scenario; None where the steps alone drive.

    A `ConfigError` has a line for each problem of its table.

    Args:
        scenario: with its table.
        config: of its bench.
        parameters: the SI value of each parameter.
    """
    if scenario.controller is None:
        return None
    problems = Problems(str(scenario.path))
    chosen = _choose(scenario, parameters, problems)
    problems.raise_any()
    if chosen is None:
        return None
    record = config_of(ONLY, ONLY, chosen, config.buses, problems)
    problems.raise_any()
    return record


def _choose(
    scenario: Scenario, parameters: Mapping[str, float], problems: Problems
) -> Chosen | None:
    controller = scenario.controller
    if controller is None:
        return None
    if controller.firmware:
        return Chosen(PROCESS, {"command": controller.firmware})
    if controller.example:
        # canopen is slow to import, and not all scenarios have an example.
        from hil_bench.abilities.controllers.python.examples import CONTROLLERS, settings_of  # noqa: PLC0415

        example, settings = CONTROLLERS[controller.example], settings_of(parameters)
        return Chosen(PYTHON, {"call": lambda rig: example(rig, settings)})
    return read_controller(ONLY, controller.table, scenario.path.parent, problems)


class RunnerDriver:
    """The runner lets time pass, tick by tick, beside a controller or alone.

    Args:
        bench: on which.
        desks: its controllers; None for nobody.
        enabled: the valve that its example enables, and whose set-points are the steps'; or none.

    Attributes:
        desks: likewise.
    """

    def __init__(self, bench: VirtualBench, desks: Desks | None, enabled: str = "") -> None:
        self._bench, self.desks = bench, desks
        self._overwritten = {f"{enabled}.{each}" for each in _SENT_BY_EXAMPLE} if enabled else ()

    def drive(self, director: Director, last_tick: int) -> str:
        """Let time pass until the run is over; return how a controller ended before that.

        Raises:
            ControllerError: one has failed.
        """
        session, tick_ns, desks = self._bench.session, self._bench.config.tick_ns, self.desks
        if desks is not None and self._overwritten:
            director.overwrites = lambda name: name in self._overwritten and not desks.have_begun
        session.tick((), 0)
        while not director.is_over and session.now < last_tick * tick_ns:
            session.tick((), session.now + tick_ns)
        if self.desks is None:
            return ""
        end = session.now + _MOST_BEHIND
        while not self.desks.have_begun and session.now < end:
            session.tick((), session.now + tick_ns)  # it says what keeps it
        if not self.desks.have_begun and session.now >= end:
            raise ControllerError("the controller had not begun its work when the run was over")
        return self.desks.ending


@contextmanager
def driver_of(prepared: resolve.PreparedScenario, bench: VirtualBench) -> Iterator[RunnerDriver]:
    """Give what drives a run, and end its controller with the run.

    Yields:
        It, before the first tick.
    """
    scenario = prepared.scenario
    chosen = controller_of(scenario, prepared.config, prepared.parameters)
    if chosen is None:
        yield RunnerDriver(bench, None)
        return
    values = {
        each.name: each.unit.from_si(prepared.parameters[each.name]) for each in scenario.parameters
    }
    with ExitStack() as stack:
        scratch = Path()
        if chosen.kind.uses_files:
            scratch = stack.enter_context(scratch_folder())
        desks = Desks([chosen], bench.session, prepared.config, scratch, values)
        stack.callback(desks.close)
        commands = [step.command for step in scenario.steps if _is_for_it(step)]
        if commands[:1] == [Power.START]:
            desks.leave_off()
        is_manual = scenario.controller is not None and scenario.controller.example == MANUAL
        yield RunnerDriver(bench, desks, _first_valve(prepared.config) if is_manual else "")


def _first_valve(config: BenchConfig) -> str:
    axis = config.first_axis.name
    valves = (each for each in config.nodes if each.kind is VALVE)
    return next((each.name for each in valves if getattr(each, "axis", None) == axis), "")


def _is_for_it(step: Step) -> TypeGuard[FirmwareStep]:
    return isinstance(step, FirmwareStep) and step.target in {"", ONLY}


def switch_problems(scenario: Scenario, config: BenchConfig) -> Iterator[str]:
    """Yield a line for each step that switches a controller that is not there."""
    others = config.of(ControllersConfig)
    names = [each.name for each in others.controllers] if others is not None else []
    if scenario.controller is not None:
        names.insert(0, ONLY)
    for step in scenario.steps:
        if not isinstance(step, FirmwareStep):
            continue
        if not names:
            yield f"{step.place}: there is no firmware; give it in [controller]"
        elif step.target and step.target not in names:
            wrong = f"{quote(step.target)} is no controller"
            yield f"{step.place}: {wrong}; the nearest is {find_nearest(step.target, names)}"
        elif not step.target and scenario.controller is None and len(names) > 1:
            yield f"{step.place}: there are several controllers; give target = {quote(names[0])}"


Halt = Callable[[VirtualBench, Stage, RunnerDriver], None]
"""Is given a run before its first tick, to have it halt somewhere."""


def _go_on(_bench: VirtualBench, _stage: Stage, _driver: RunnerDriver) -> None:
    pass


def _alone(_bench: VirtualBench, _stage: Stage) -> AbstractContextManager[object]:
    return nullcontext()


class PlayOptions(NamedTuple):
    """The options of playing a scenario.

    Attributes:
        stops_at_failure: whether a run ends when the first requirement has failed.
        record: what to record in files.
        keeps_evidence: whether the run keeps what a report shows.
        reader: makes what reads the frames of the bench, as a part of the evidence.
        halt: is given the run before its first tick.
        beside: open while the run goes on; given the bench, and the scenario on it.
    """

    stops_at_failure: bool = False
    record: RecordingWish | None = None
    keeps_evidence: bool = False
    reader: Callable[[VirtualBench], FrameReader] | None = None
    halt: Halt = _go_on
    beside: Callable[[VirtualBench, Stage], AbstractContextManager[object]] = _alone


PLAIN = PlayOptions()


@dataclass(frozen=True, slots=True)
class Run:
    """The findings of a run.

    Attributes:
        findings: the judgement on each requirement, in the order of the file.
        duration: how long it was [s].
        is_early: whether it ended before the scenario does.
        ending: how the controller ended before the run did; empty where it did not.
        evidence: for a report; None where none was asked for.
    """

    findings: tuple[Finding, ...]
    duration: float
    is_early: bool
    ending: str
    evidence: Evidence | None = field(default=None, compare=False)


def prepare(
    scenario: Scenario,
    given: Mapping[str, float] | None = None,
    *,
    seed: int | None = None,
    tables: Mapping[str, object] | None = None,
) -> resolve.PreparedScenario:
    """Return a scenario with its numbers in, checked against its bench.

    Args:
        scenario: as loaded.
        given: values of parameters, in their own units, that win over the file's.
        seed: takes the place of the bench's own.
        tables: tables of the bench's file, nested; their keys win over its own.

    A `ConfigError` has a line for each problem.
    """
    config = load_config(scenario.bench_path, seed=seed, tables=tables)
    return prepare_on(config, scenario, resolve.parameter_values(scenario, given))


def prepare_on(
    config: BenchConfig,
    scenario: Scenario,
    values: Mapping[str, float],
    *,
    keeps_session: bool = False,
    drives_itself: bool = True,
) -> resolve.PreparedScenario:
    """Return a scenario with its numbers in, checked against a bench.

    Args:
        config: the bench, whatever the scenario names.
        scenario: as loaded.
        values: the SI value of each parameter.
        keeps_session: keep the bench that it was checked on for the run that follows.
        drives_itself: whether the scenario's controller drives; else one on a bus does, which may
            enable and read what no step does.

    Raises:
        ConfigError: something does not fit; a line a problem.
    """
    units = (config.of(FaultsPart) or FaultsPart()).sensor_units
    actions = resolve.resolve_steps(scenario, config.tick_ns, values, units)
    session = open_session(config)
    requirements: tuple[resolve.Requirement, ...] = ()
    problems = [
        *_controller_problems(scenario, config, values),
        *usage_problems(scenario),
        *_step_problems(actions, config, session),
    ]
    if not problems and drives_itself:
        nodes = dict(zip((each.name for each in config.nodes), session.bench.nodes, strict=True))
        problems += idle_steps(scenario, actions, config, nodes)
    try:
        vocabulary = bench_vocabulary(config, session, values)
        requirements = resolve.compile_expectations(scenario, vocabulary, config.tick_ns)
    except ConfigError as error:
        problems.append(str(error))
    if problems:
        raise ConfigError("\n".join(problems))
    sessions = [session] if keeps_session else []
    return resolve.PreparedScenario(scenario, config, values, actions, requirements, sessions)


def play(prepared: resolve.PreparedScenario, options: PlayOptions = PLAIN) -> Run:
    """Play a scenario on a fresh bench, and judge; a `ControllerError` says that firmware failed.

    A `ConfigError` says that a step cannot do what it is to do.
    """
    config, last_tick = prepared.config, prepared.last_tick
    with _open_bench(prepared, options) as bench, driver_of(prepared, bench) as driver:
        stage = Stage(prepared, bench.session, stops_at_failure=options.stops_at_failure)
        options.halt(bench, stage, driver)
        with options.beside(bench, stage):
            ending = driver.drive(stage.director, last_tick)
        witness = stage.witness
        evidence = None
        if options.keeps_evidence:
            evidence = Evidence(
                bench.signals[: witness.ticks],
                witness.columns(),
                witness.ticks,
                config.tick_ns,
                tuple(event_spans(bench.bench, bench.now())),
                tuple(bench.frames),
                options.reader(bench) if options.reader is not None else None,
                last_tick + 1,
            )
    table = prepared.scenario.controller.table if prepared.scenario.controller else {}
    is_mute = table.get("kind") == "program" and stage.is_silent
    findings = stage.judge((_MUTE,) if is_mute else ())
    duration = max(witness.ticks - 1, 0) * config.tick_ns * 1e-9
    return Run(findings, duration, witness.ticks <= last_tick, ending, evidence)


def _open_bench(prepared: resolve.PreparedScenario, options: PlayOptions) -> VirtualBench:
    config = prepared.config
    kept = (prepared.last_tick + 1) * config.tick_ns * 1e-9 if options.keeps_evidence else 0.0
    frames = MOST_FRAMES if options.reader is not None else 0
    return VirtualBench(
        config,
        recorded_time=kept,
        logged_frames=frames,
        session=prepared.sessions.pop() if prepared.sessions else None,
        record=options.record,
    )


def _controller_problems(
    scenario: Scenario, config: BenchConfig, values: Mapping[str, float]
) -> Iterator[str]:
    controller = scenario.controller
    if controller is not None and controller.example and controller.example not in EXAMPLES:
        near = find_nearest(controller.example, EXAMPLES)
        wrong = f"{quote(controller.example)} is no example; the nearest is {near}"
        yield f"{scenario.path}: controller.example: {wrong}"
        return
    chosen = None
    try:
        chosen = controller_of(scenario, config, values)
    except ConfigError as error:
        yield from str(error).splitlines()
    yield from switch_problems(scenario, config)
    for step in scenario.steps:
        if isinstance(step, SyncStep) and chosen is not None and chosen.kind.is_clock:
            wrong = "the firmware's SYNC lets bench time pass, so it cannot be switched"
            yield f"{step.place}: {wrong}; kill the firmware instead"


def _step_problems(
    actions: tuple[resolve.TimedAction, ...], config: BenchConfig, session: Session
) -> Iterator[str]:
    targets, faults = Targets(config, session), session.bench.part(Faults).rehearsal()
    for _, action, place in actions:
        try:
            match action:
                case resolve.SetAction():
                    target = targets.find(action.target)
                    targets.check_units(action.target, action.units)
                    for value in action.values:
                        targets.check(target, value)
                case FaultConfig():
                    schedule_faults(faults, (action,))
                case NmtStep():
                    targets.check_node(action.target)
        except ConfigError as error:
            yield f"{place}: {error}"
