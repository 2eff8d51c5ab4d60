"""Scenarios on a machine: what of them exists there, and what is refused before anything moves.

There are the set-point of the valve and what its drivers tell. Faults, loads and whatever else
needs the virtual bench is refused by name.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.j1939.kinds.auxiliary_valve import SET_POINT
from hil_bench.abilities.scenario.nodes import channel_vocabulary
from hil_bench.abilities.scenario.recorded import Trace
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, Scenario, SyncStep
from hil_bench.abilities.scenario.resolve import (
    Requirement,
    SetAction,
    TimedAction,
    compile_expectations,
    parameter_values,
    resolve_steps,
)
from hil_bench.abilities.scenario.targets import check_unit
from hil_bench.abilities.scenario.usage import usage_problems
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Channel, Recording
from hil_bench.units import ONE

_MANUAL = "manual"
_RIGHT = "leave it out on a machine"


@dataclass(frozen=True, slots=True)
class MachineScenario:
    """A scenario that a machine can play.

    Attributes:
        scenario: as loaded.
        parameters: the SI value of each parameter.
        set_points: of the valve.
        requirements: its expectations.
    """

    scenario: Scenario
    parameters: Mapping[str, float]
    set_points: "SetPoints"
    requirements: tuple[Requirement, ...]


class SetPoints:
    """The set-point of a valve over the time of a run: 0 until the first step.

    Args:
        actions: the steps, in the order of time, all for that valve.
        tick_ns: time between two ticks [ns].
    """

    def __init__(self, actions: Iterable[tuple[int, SetAction]], tick_ns: int) -> None:
        self._tick = tick_ns * 1e-9
        self._courses: list[tuple[Sequence[float], Sequence[float]]] = []
        for tick, action in actions:
            points = action.points(tick, self._at(tick))
            self._courses.append(([t for t, _ in points], [value for _, value in points]))

    def at(self, time: float) -> float:
        """Return the set-point [-] at a time of the run [s]."""
        return self._at(round(time / self._tick, 6))  # a tick is a tick, however it was computed

    def _at(self, tick: float) -> float:
        for ticks, values in reversed(self._courses):
            if ticks[0] <= tick:
                return float(np.interp(tick, ticks, values))
        return 0.0


def prepare_for_machine(
    scenario: Scenario,
    given: Mapping[str, float],
    *,
    tick_ns: int,
    valve: str,
    channels: Iterable[Channel],
) -> MachineScenario:
    """Return a scenario that a machine can play.

    Args:
        scenario: as loaded.
        given: values of parameters, in their own units, that win over the file's.
        tick_ns: at which its steps act on the bench [ns].
        valve: the name of the valve's node.
        channels: what the drivers tell.

    Raises:
        ConfigError: something of it does not exist there, or does not fit; a line a problem.
    """
    values = parameter_values(scenario, given)
    actions = resolve_steps(scenario, tick_ns, values)
    problems = [
        *_controller_problems(scenario),
        *usage_problems(scenario),
        *(line for each in actions for line in _step_problems(each, f"{valve}.{SET_POINT}")),
    ]
    requirements: tuple[Requirement, ...] = ()
    try:
        vocabulary = channel_vocabulary(channels, values)
        requirements = compile_expectations(scenario, vocabulary, tick_ns)
    except ConfigError as error:
        problems.append(f"{error}; a machine has only what its sensors measure")
    if problems:
        raise ConfigError("\n".join(problems))
    moves = [(each.tick, each.action) for each in actions if isinstance(each.action, SetAction)]
    return MachineScenario(scenario, values, SetPoints(moves, tick_ns), requirements)


def lay_samples(samples: Recording, channels: Mapping[str, str], ticks: int, tick: float) -> Trace:
    """Return samples on the grid of a run; what was not sampled is unknown there.

    Args:
        samples: the first one at time 0 of the run.
        channels: of each signal of the run, the field of the samples.
        ticks: of the run.
        tick: time between two [s].
    """
    times = samples[TIME.name] - samples[TIME.name][0]
    places = np.rint(times / tick).astype(np.int64)
    is_inside = places < ticks
    columns = {}
    for name, field in channels.items():
        columns[name] = np.full(ticks, math.nan)
        columns[name][places[is_inside]] = samples[field][is_inside]
    return Trace(columns, ticks, round(tick * 1e9), ticks)


def _controller_problems(scenario: Scenario) -> Iterator[str]:
    controller = scenario.controller
    if controller is not None and controller.example != _MANUAL:
        right = f'give example = "{_MANUAL}", or no [controller]'
        yield f"{scenario.path}: controller: on a machine the steps alone drive; {right}"


def _step_problems(timed: TimedAction, target: str) -> Iterator[str]:
    action, place = timed.action, timed.place
    match action:
        case FaultConfig():
            what = f"the fault {action.kind} of {action.target} needs the virtual bench; {_RIGHT}"
            yield f"{place}: {what}"
        case SetAction() if action.target != target:
            wrong = f"{action.target} cannot be set on a machine"
            yield f"{place}: {wrong}; only {target} can"
        case SetAction():
            try:
                for symbol in action.units:
                    check_unit(target, symbol, ONE.symbol)
            except ConfigError as error:
                yield f"{place}: {error}"
            for value in action.values:
                if not -1.0 <= value <= 1.0:
                    yield f"{place}: {value:g} is out of range; give -1 to 1 of full opening"
        case NmtStep() | SyncStep():
            yield f"{place}: NMT commands and SYNC are the test's own on a machine; {_RIGHT}"
        case FirmwareStep():
            yield f"{place}: there is no firmware on a machine; {_RIGHT}"
