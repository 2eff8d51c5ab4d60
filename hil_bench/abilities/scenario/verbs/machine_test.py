"""`hil-bench test` on a machine: the same files, guarded and with a dead man as `commission` is."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

from hil_bench.abilities.commissioning.journal import SettingsJournal
from hil_bench.abilities.commissioning.measures import SAMPLE_CHANNELS
from hil_bench.abilities.commissioning.plan import (
    CommissioningPlan,
    LimitError,
    Limits,
    check_against,
    choose_axis,
    load_plan,
)
from hil_bench.abilities.commissioning.rig import Procedure, Rig, communication
from hil_bench.abilities.commissioning.session import recorded_channels
from hil_bench.abilities.commissioning.verbs import commission_settings as settings
from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.abilities.common.controller_side import OpenNetwork, open_network
from hil_bench.abilities.common.files import make_directory
from hil_bench.abilities.common.members import Members, find_members
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.common.terminal import CLEARANCE, agrees
from hil_bench.abilities.common.work import ShownRows, WorkView, hold_to_real_time, watched_work
from hil_bench.abilities.recording.options import recording_code, report_lines
from hil_bench.abilities.recording.recorder import RecordingSink
from hil_bench.abilities.recording.work import recorded_work
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.recorded import (
    MachineScenario,
    judge_trace,
    lay_samples,
    prepare_for_machine,
)
from hil_bench.abilities.scenario.records import Scenario, ticks_of
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.results import ScenarioResult, blank_result
from hil_bench.abilities.scenario.verbs.scenario_view import show_results
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.arguments import add_bus_arguments, load_bench_config
from hil_bench.cli.exit_codes import Ending, ExitCode, interrupted_once
from hil_bench.cli.results import is_silent
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_drivers import BusLostError, DriverError

# The machine side: arguments, limits, consent.

# `-k`: which requirements of which scenarios are chosen, prepared one after the other.

Prepared = TypeVar("Prepared", PreparedScenario, MachineScenario)


def prepare_chosen(
    args: argparse.Namespace, paths: Sequence[Path], prepare: Callable[[Scenario], Prepared]
) -> list[Prepared]:
    """Return the scenarios that have a chosen requirement, with those alone.

    Args:
        args: of the command line, with `k`.
        paths: the files of the scenarios.
        prepare: checks a scenario against what it is played on.

    Raises:
        ConfigError: something is wrong in any of them, or nothing is chosen.
    """

    def is_chosen(text: str) -> bool:
        return args.k.lower() in text.lower()

    chosen, wrong = [], []
    for path in paths:
        try:
            prepared = prepare(load_scenario(path))
        except ConfigError as error:
            wrong.append(str(error))
            continue
        about = f"{path}\n{prepared.scenario.title}\n"
        requirements = tuple(each for each in prepared.requirements if is_chosen(about + each.id))
        ids = tuple(each for each in prepared.scenario.requirement_ids if is_chosen(about + each))
        if requirements:
            scenario = replace(prepared.scenario, requirement_ids=ids)
            chosen.append(replace(prepared, requirements=requirements, scenario=scenario))
    if wrong:
        raise ConfigError("\n".join(wrong))
    if not chosen:
        raise ConfigError(f"-k {args.k}: no requirement; 'hil-bench scenario list' shows all")
    return chosen


@dataclass(frozen=True, slots=True)
class Machine:
    """The axis that scenarios move.

    Attributes:
        config: the machine as it should be: nodes, EDS files, data sheet.
        plan: of its commissioning, which has the limits.
        axis: the axis.
        members: its nodes.
    """

    config: BenchConfig
    plan: CommissioningPlan
    axis: CylinderConfig
    members: Members

    @property
    def limits(self) -> Limits:
        """Those of the plan, that hold for each of its steps."""
        return self.plan.steps[0].limits

    @property
    def fields(self) -> Mapping[str, Channel]:
        """Of each signal that the drivers tell, the channel of the samples."""
        known = {channel.name: channel for channel in SAMPLE_CHANNELS}
        named = {f"{self.axis.name}.{name}": channel for name, channel in known.items()}
        position = self.members.position.name
        return named | {
            f"{position}.measured": known["position"],
            f"{position}.measured_speed": known["speed"],
            f"{self.members.pressure_a.name}.measured": known["P_A"],
            f"{self.members.pressure_b.name}.measured": known["P_B"],
        }


_FOLDER = Path("hil-bench-commissioning")


def add_machine_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns a machine."""
    add_bus_arguments(parser, "machine")
    group = parser.add_argument_group("motion of a machine (docs/scenarios.md)")
    group.add_argument(
        "--plan",
        type=Path,
        metavar="PLAN.toml",
        help="plan of the machine's commissioning, with axis, period and the [limits] that close "
        "the valve",
    )
    group.add_argument("--yes", action="store_true", help="move without asking")
    group.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder for the devices' settings until they are restored (default: {_FOLDER})",
    )
    group.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="record what the drivers receive while the scenario plays; the suffix gives the "
        "format: .mf4 signals and frames, .csv signals",
    )
    parser.set_defaults(virtual=False, on=None, config=None)


def is_on_machine(args: argparse.Namespace) -> bool:
    """Return True if the command line names a bus; refuse the options that need one without it.

    Raises:
        ConfigError: a plan without a bus, a bus without a plan, or a seed.
    """
    has_bus = "interface" in args or "channel" in args
    given = {name for name in ("plan", "yes", "output") if getattr(args, name)}
    given |= {"bitrate", "fd", "data_bitrate", "bus_kwargs"} & {*vars(args)}
    if not has_bus and given:
        name = min(given).replace("_", "-")
        raise ConfigError(f"--{name}: belongs to a machine; give its bus with -i and -c")
    if not has_bus and args.record is not None:
        right = "hil-bench run --scenario records a virtual bench"
        raise ConfigError(f"--record: belongs to a machine; {right}")
    if args.record is not None and args.record.suffix.lower() not in {".mf4", ".csv"}:
        raise ConfigError(f"--record {args.record}: give a file name that ends in .mf4 or .csv")
    if has_bus and args.plan is None:
        raise ConfigError("-i, -c: a machine needs limits; give --plan PLAN.toml of commission")
    if has_bus and (args.seed is not None or args.stop_at_failure or args.report):
        raise ConfigError("--seed, --stop-at-failure, --report: are for the virtual bench")
    return has_bus


def load_machine(args: argparse.Namespace, paths: Sequence[Path]) -> Machine:
    """Return the machine of the plan; where the plan names no bench, of the scenarios.

    Raises:
        ConfigError: the scenarios name several benches, or the plan does not fit the machine.
    """
    args.output = args.output or _FOLDER
    plan = load_plan(args.plan)
    benches = {load_scenario(path).bench_path for path in paths}
    if plan.bench is None and len(benches) > 1:
        right = "give plan.bench, the file of the machine"
        raise ConfigError(f"{args.plan}: the scenarios have several benches; {right}")
    path = plan.bench if plan.bench is not None else benches.pop()
    args.config = None if path is None else str(path)
    config = seen_from_bus(args, load_bench_config(args))
    axis = choose_axis(plan, config)
    check_against(plan, axis)
    return Machine(config, plan, axis, find_members(config, axis.name, "a test on a machine"))


def prepare_all(
    args: argparse.Namespace, machine: Machine, paths: Sequence[Path], given: Mapping[str, float]
) -> list[MachineScenario]:
    """Return all scenarios with the requirements that were chosen.

    A `ConfigError` says what in any of them does not exist on a machine, or that nothing is chosen.
    """
    channels = [Channel(name, channel.unit) for name, channel in machine.fields.items()]

    def prepare(scenario: Scenario) -> MachineScenario:
        prepared = prepare_for_machine(
            scenario,
            given,
            tick_ns=machine.config.tick_ns,
            valve=machine.members.valve.name,
            channels=channels,
        )
        if scenario.duration > machine.limits.time:
            wrong = f"lasts {scenario.duration:g} s, the limit is {machine.limits.time:g} s"
            right = f"give a longer time_s in [limits] of {args.plan}"
            raise ConfigError(f"{scenario.path}: {wrong}; {right}")
        return prepared

    return prepare_chosen(args, paths, prepare)


def check_consent(args: argparse.Namespace) -> None:
    """Refuse a motion that nobody can be asked about.

    Raises:
        ConfigError: there is nobody to ask.
    """
    if not (args.yes or sys.stdin.isatty()):
        wrong = "motion needs a confirmation, and this is no terminal"
        raise ConfigError(f"{wrong}; give --yes to move without asking")


def is_confirmed(
    args: argparse.Namespace,
    opened: OpenNetwork,
    machine: Machine,
    chosen: Sequence[MachineScenario],
) -> bool:
    """Ask before the first motion."""
    if args.yes:
        return True
    low, high = (1e3 * bound for bound in machine.limits.position)
    print(f"The axis on {opened.description} is going to move:", file=sys.stderr)
    for each in chosen:
        what = f"{each.scenario.path}: for {each.scenario.duration:g} s"
        print(f"  {what}, from {low:g} to {high:g} mm", file=sys.stderr)
    return agrees(CLEARANCE, "yes")


# Scenarios played on a machine.

_NOT_RUN = "not run: an earlier scenario was stopped"


class Samples(NamedTuple):
    """The destinations of the samples.

    Attributes:
        view: what people see.
        rows: takes each sample.
        origin: its time 0 on the network's clock [s].
        ending: counts what a run leaves undone.
    """

    view: WorkView
    rows: ShownRows
    origin: float
    ending: Ending


def play_on_machine(
    args: argparse.Namespace, paths: Sequence[Path], given: Mapping[str, float], ending: Ending
) -> list[ScenarioResult]:
    """Play scenarios on a machine; all of them are checked before the bus is opened.

    Settings that are not restored and a recording that is lost are counted in `ending`.

    Raises:
        ConfigError: something in them does not exist there, or motion was not confirmed.
    """
    machine = load_machine(args, paths)
    chosen = prepare_all(args, machine, paths, given)
    check_consent(args)
    make_directory(args.output)
    journal = settings.open_journal(args)
    with open_network(args, machine.config) as opened, interrupted_once():
        if not is_confirmed(args, opened, machine, chosen):
            raise ConfigError("motion was not confirmed; nothing was moved")
        title, axis = f"{', '.join(map(str, paths))} on {opened.description}", machine.axis.name
        results: list[ScenarioResult] = []
        channels = recorded_channels(axis)
        stages = (str(each.scenario.path) for each in chosen)
        work = Work("test", len(chosen), "scenarios")
        work.stage = next(stages)
        with (
            watched_work(args, "test", title, channels) as view,
            shown_work(args, work),
            _recorded(args, opened, channels, ending) as (recording, origin),
        ):
            samples = Samples(view, ShownRows(recording, view), origin, ending)
            if view.is_watched and opened.virtual is not None:
                hold_to_real_time(opened.virtual.session)
            show_results(view, results, len(chosen))
            for result in play_all(args, opened, machine, chosen, journal, samples):
                results.append(result)
                work.done, work.stage = len(results), next(stages, "")
                show_results(view, results, len(chosen))
        return results


def play_all(
    args: argparse.Namespace,
    opened: OpenNetwork,
    machine: Machine,
    chosen: Sequence[MachineScenario],
    journal: SettingsJournal,
    samples: Samples,
) -> Iterator[ScenarioResult]:
    """Play scenarios one after the other; behind one that was stopped nothing moves any more.

    Yields:
        What came of each.
    """
    is_stopped = is_interrupted = False
    for each in chosen:
        if is_stopped:
            blank = _result(machine, each, problem=_NOT_RUN)
            yield replace(blank, is_interrupted=is_interrupted)
            continue
        samples.view.show(
            now=str(each.scenario.path),
            detail=settings.limits_text(machine.limits),
            limits=settings.limits_by_channel(machine.axis.name, machine.limits),
        )
        rig = Rig(
            opened.network,
            machine.members,
            period=machine.plan.period,
            recording=samples.rows,
            origin=samples.origin,
            journal=journal,
        )
        try:
            result = _play(opened, machine, each, rig)
        finally:
            returned = rig.close()
            settings.print_returned(
                returned, settings.restore_command(args), is_quiet=is_silent(args)
            )
            if returned.unrestored:
                samples.ending.take(ExitCode.CHECK_FAILED)
        is_stopped, is_interrupted = bool(result.problem), result.is_interrupted
        yield result


@contextlib.contextmanager
def _recorded(
    args: argparse.Namespace, opened: OpenNetwork, channels: Sequence[Channel], ending: Ending
) -> Iterator[tuple[RecordingSink | None, float]]:
    """Record where --record says so.

    Yields:
        What takes the samples, and time 0 on the network's clock [s].
    """
    if args.record is None:
        yield None, opened.network.now()
        return
    with recorded_work(args.record, opened, channels, "test on a machine") as (recording, origin):
        yield recording, origin
    ending.take(recording_code(recording.report))
    lines = report_lines(recording.report)
    if lines and not is_silent(args):
        print("\n".join(lines), file=sys.stderr)


def _play(opened: OpenNetwork, machine: Machine, each: MachineScenario, rig: Rig) -> ScenarioResult:
    """Play a scenario; whatever stops it, the valve is closed before anybody is told."""
    try:
        obstacle = _set_up(opened, machine, rig)
        if obstacle:
            return _result(machine, each, problem=obstacle)
        samples = _move(machine, each, rig)
    except KeyboardInterrupt:
        stopped = _result(machine, each, problem=f"interrupted; {_closing(rig)}")
        return replace(stopped, is_interrupted=True)
    except BusLostError as error:
        problem = f"the bus was lost: {error}; the valve closes by itself"
        return _result(machine, each, problem=problem)
    except (LimitError, DriverError) as error:
        return _result(machine, each, problem=f"{error}; {_closing(rig)}")
    period = machine.plan.period
    ticks = ticks_of(each.scenario.duration, round(period * 1e9))
    fields = {name: channel.name for name, channel in machine.fields.items()}
    trace = lay_samples(samples, fields, ticks, period)
    findings = tuple(judge_trace(requirement, trace) for requirement in each.requirements)
    result = _result(machine, each)
    return replace(result, findings=findings, duration=(ticks - 1) * period)


def _set_up(opened: OpenNetwork, machine: Machine, rig: Rig) -> str:
    """Compare the nodes with their EDS files and set them up; return what forbids motion."""
    procedure = Procedure(opened.network, machine.config, machine.axis, machine.members, rig)
    rig.begin_step(0, machine.limits)
    found = communication(procedure, machine.plan.steps[0])
    wrong = [f"{finding.name}: {finding.evidence}" for finding in found.findings]
    return "; ".join(filter(None, [found.problem, *wrong]))


def _move(machine: Machine, each: MachineScenario, rig: Rig) -> Recording:
    rig.begin_step(1, machine.limits)
    rig.enable()
    samples = rig.move(each.set_points.at, each.scenario.duration + machine.plan.period)
    rig.close_valve()
    return samples


def _closing(rig: Rig) -> str:
    """Close the valve and return how that went."""
    if rig.close_valve():
        return "the valve was closed"
    return "the valve does not say that it is closed; without us it closes by itself"


def _result(machine: Machine, each: MachineScenario, problem: str = "") -> ScenarioResult:
    return blank_result(each.scenario, machine.config.seed, each.parameters, problem)
