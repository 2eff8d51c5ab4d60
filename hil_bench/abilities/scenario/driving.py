"""Controllers of a run, and its time, which the runner lets pass."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TypeGuard

from hil_bench.abilities.controllers.desk import ControllerConfig, Desks
from hil_bench.abilities.controllers.kinds import Chosen, read_controller
from hil_bench.abilities.controllers.power import ONLY, Power
from hil_bench.abilities.controllers.process.kind import KIND as PROCESS
from hil_bench.abilities.controllers.python.kind import KIND as PYTHON
from hil_bench.abilities.controllers.section import ControllersConfig, config_of
from hil_bench.abilities.scenario.director import Director
from hil_bench.abilities.scenario.prepared import PreparedScenario
from hil_bench.abilities.scenario.records import FirmwareStep, Scenario, Step
from hil_bench.bench.configuration import BenchConfig
from hil_bench.config.document import give
from hil_bench.config.settings import Origin, Problems
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ControllerError
from hil_bench.scratch import scratch_folder
from hil_bench.session.virtual_bench import VirtualBench

_MOST_BEHIND = 10_000_000_000
"""Time behind a run [ns] that a controller has to say why it had not begun its work."""


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
        from hil_bench.abilities.controllers.python.examples import (  # noqa: PLC0415
            CONTROLLERS,
            settings_of,
        )

        example, settings = CONTROLLERS[controller.example], settings_of(parameters)
        return Chosen(PYTHON, {"call": lambda rig: example(rig, settings)})
    given = give(ONLY, controller.table, Origin.FILE, problems)
    return read_controller(ONLY, given, scenario.path.parent, problems)


class RunnerDriver:
    """The runner lets time pass, tick by tick, beside a controller or alone.

    Args:
        bench: on which.
        desks: its controllers; None for nobody.

    Attributes:
        desks: likewise.
    """

    def __init__(self, bench: VirtualBench, desks: Desks | None) -> None:
        self._bench, self.desks = bench, desks

    def drive(self, director: Director, last_tick: int) -> str:
        """Let time pass until the run is over; return how a controller ended before that.

        Raises:
            ControllerError: one has failed.
        """
        session, tick_ns = self._bench.session, self._bench.config.tick_ns
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
def driver_of(prepared: PreparedScenario, bench: VirtualBench) -> Iterator[RunnerDriver]:
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
        yield RunnerDriver(bench, desks)


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
