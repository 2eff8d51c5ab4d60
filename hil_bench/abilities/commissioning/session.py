"""A whole commissioning: the steps of a plan one after the other, and what they found."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from hil_bench.abilities.commissioning.discovery import Method, discover
from hil_bench.abilities.commissioning.identity import NodeDescription, describe
from hil_bench.abilities.commissioning.journal import Returned, SettingsJournal
from hil_bench.abilities.commissioning.measures import (
    SAMPLE_CHANNELS,
    Diagnosis,
    StepResult,
    Verdict,
)
from hil_bench.abilities.commissioning.plan import (
    CommissioningPlan,
    LimitError,
    Step,
    StepKind,
    check_against,
    choose_axis,
)
from hil_bench.abilities.commissioning.responses import chirp, direction, steps, stuck_pressures
from hil_bench.abilities.commissioning.rig import PATIENCE, Procedure, Rig, communication
from hil_bench.abilities.commissioning.sweeps import dead_band, leakage, ramp, sensors
from hil_bench.abilities.common.members import find_members
from hil_bench.bench.configuration import BenchConfig
from hil_bench.outside.recording.channels import Channel, RowSink
from hil_drivers import BusLostError, DriverError, Network

logger = logging.getLogger(__name__)

INTERRUPTED = "interrupted"
"""How the problem of the step begins in which Ctrl-C came."""


def recorded_channels(axis: str) -> tuple[Channel, ...]:
    """Return the signals of a commissioning's recording, after the time.

    They have the names of a bench's recording, so that it can be drawn and replayed like one, and
    hold what the drivers told; `step` is the number of the step, from 1.
    """
    samples = [Channel(f"{axis}.{channel.name}", channel.unit) for channel in SAMPLE_CHANNELS]
    return (*samples, Channel("step", "-"))


_STEPS: Mapping[StepKind, Callable[[Procedure, Step], StepResult]] = {
    StepKind.COMMUNICATION: communication,
    StepKind.SENSORS: sensors,
    StepKind.DIRECTION: direction,
    StepKind.DEAD_BAND: dead_band,
    StepKind.RAMP: ramp,
    StepKind.STEPS: steps,
    StepKind.CHIRP: chirp,
    StepKind.LEAKAGE: leakage,
}

_DECISIVE = {StepKind.COMMUNICATION, StepKind.DIRECTION}
"""Steps without which the axis is not moved any further."""


@dataclass(frozen=True, slots=True)
class Commissioning:
    """The findings of a commissioning.

    Attributes:
        axis: the axis.
        results: one a step of the plan.
        nodes: what each node says of itself.
        missed: samples for which not every device answered in time.
        lost: how the bus was lost, empty where it was not.
        is_interrupted: whether Ctrl-C ended it.
        returned: what was changed at the nodes, and restored.
    """

    axis: str
    results: tuple[StepResult, ...]
    nodes: tuple[NodeDescription, ...]
    missed: int
    lost: str = ""
    is_interrupted: bool = False
    returned: Returned = field(default_factory=Returned)

    @property
    def passed(self) -> bool:
        """Return True if every step has."""
        return all(result.verdict is Verdict.PASSED for result in self.results)

    @property
    def verdict(self) -> str:
        """The verdict on the whole: inconclusive where no step failed, but one was not run."""
        if self.passed:
            return "passed"
        found = {result.verdict for result in self.results if not result.is_interrupted}
        return "failed" if found & {Verdict.FAILED, Verdict.STOPPED} else "inconclusive"

    @property
    def findings(self) -> list[Diagnosis]:
        """The faults named, in the order of the steps."""
        return [finding for result in self.results for finding in result.findings]


class Console(NamedTuple):
    """Whom a commissioning talks to.

    Attributes:
        confirm: asked once before the first motion; False leaves all motion out.
        begin: told each step as it begins.
        end: told each step's result.
        returned: told at the very end, whatever ended it, what was changed and restored.
    """

    confirm: Callable[[], bool] = lambda: True
    begin: Callable[[Step], None] = lambda _step: None
    end: Callable[[StepResult], None] = lambda _result: None
    returned: Callable[[Returned], None] = lambda _returned: None


UNATTENDED = Console()
"""Nobody: moves without asking."""


def commission(
    network: Network,
    config: BenchConfig,
    plan: CommissioningPlan,
    *,
    console: Console = UNATTENDED,
    recording: RowSink | None = None,
    origin: float | None = None,
    journal: SettingsJournal | None = None,
) -> Commissioning:
    """Run a plan on the axis behind a bus, and leave its valve disabled, all else as it was.

    A lost bus, a limit or Ctrl-C ends the motion, not the function: what was found is returned.

    Args:
        network: of the drivers.
        config: the bench as it should be: nodes, EDS files, data sheet.
        plan: the steps.
        console: whom to ask and to tell.
        recording: takes the samples, with `recorded_channels`.
        origin: time 0 of the recording on the network's clock [s]; None for now.
        journal: notes what is written to the nodes, to restore it.
    """
    axis = choose_axis(plan, config)
    check_against(plan, axis)
    members = find_members(config, axis.name, "commissioning")
    rig = Rig(
        network, members, period=plan.period, recording=recording, origin=origin, journal=journal
    )
    sightings = discover(network, Method.SDO, patience=PATIENCE)
    nodes = [describe(network, sighting) for sighting in sightings]
    procedure = Procedure(network, config, axis, members, rig)
    try:
        results = _run_steps(procedure, plan.steps, console)
    finally:
        returned = rig.close()
        console.returned(returned)
    return Commissioning(
        axis.name,
        tuple(results),
        tuple(nodes),
        rig.missed,
        lost=next((result.problem for result in results if result.is_bus_lost), ""),
        is_interrupted=any(result.is_interrupted for result in results),
        returned=returned,
    )


def _run_steps(procedure: Procedure, planned: Sequence[Step], console: Console) -> list[StepResult]:
    results: list[StepResult] = []
    obstacle, is_confirmed = "", False
    for number, step in enumerate(planned, start=1):
        try:
            if not obstacle and step.kind.moves and not is_confirmed:
                is_confirmed, obstacle = _ask(console)
            console.begin(step)
            if obstacle:
                result = _not_run(step, obstacle)
            else:
                result = _run_step(procedure, number, step)
                if step.kind in _DECISIVE and result.verdict is not Verdict.PASSED:
                    obstacle = f"step {step.kind} {result.verdict}"
                elif result.verdict is Verdict.STOPPED:
                    obstacle = f"step {step.kind} was stopped"
            results.append(result)
            console.end(result)
        except KeyboardInterrupt:  # between two steps
            obstacle = INTERRUPTED
            results += [_not_run(step, obstacle)] * (len(results) < number)
    return results


def _not_run(step: Step, obstacle: str) -> StepResult:
    result = StepResult(step.kind, Verdict.NOT_RUN, problem=obstacle)
    result.is_interrupted = obstacle == INTERRUPTED
    return result


def _ask(console: Console) -> tuple[bool, str]:
    """Ask for the permission to move; return it, and the reason for a refusal."""
    try:
        is_confirmed = console.confirm()
    except KeyboardInterrupt:
        return False, INTERRUPTED
    return is_confirmed, "" if is_confirmed else "motion was not confirmed"


def _run_step(procedure: Procedure, number: int, step: Step) -> StepResult:
    """Run a step; whatever stops it, the valve is closed before anybody is told."""
    rig, network = procedure.rig, procedure.network
    begin = network.now()
    rig.begin_step(number, step.limits)
    result = StepResult(step.kind, Verdict.STOPPED)
    try:
        result = _STEPS[step.kind](procedure, step)
        if step.kind.moves:
            rig.close_valve()
            stuck = [] if result.trace is None else stuck_pressures(result.trace)
            result.findings = stuck or result.findings  # others rest on that pressure
    except KeyboardInterrupt:
        result.is_interrupted = True
        result.problem = f"{INTERRUPTED}; {_closing(rig, step)}"
    except BusLostError as error:
        result.is_bus_lost = True
        result.problem = f"the bus was lost: {error}; the valve closes by itself"
    except (LimitError, DriverError) as error:
        result.problem = f"{error}; {_closing(rig, step)}"
    result.duration = network.now() - begin
    result.judge()
    return result


def _closing(rig: Rig, step: Step) -> str:
    """Close the valve and return how that went."""
    if rig.close_valve():
        return "the valve was closed" if step.kind.moves else "the valve is closed"
    return "the valve does not say that it is closed; without us it closes by itself"
