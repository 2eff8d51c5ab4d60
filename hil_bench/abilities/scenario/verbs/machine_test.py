"""`hil-bench test` on a machine: the same files, guarded and with a dead man as `commission` is."""

import argparse
import contextlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.commissioning.journal import SettingsJournal
from hil_bench.abilities.commissioning.plan import LimitError
from hil_bench.abilities.commissioning.procedure import Procedure, communication
from hil_bench.abilities.commissioning.rig import Rig
from hil_bench.abilities.commissioning.session import recorded_channels
from hil_bench.abilities.commissioning.verbs import commission_settings as settings
from hil_bench.abilities.common.controller_side import OpenNetwork, open_network
from hil_bench.abilities.common.files import make_directory
from hil_bench.abilities.common.work import ShownRows, WorkView, hold_to_real_time, watched_work
from hil_bench.abilities.recording.options import recording_code, report_lines
from hil_bench.abilities.recording.recorder import RecordingSink
from hil_bench.abilities.recording.work import recorded_work
from hil_bench.abilities.scenario.recorded import MachineScenario, judge_trace, lay_samples
from hil_bench.abilities.scenario.records import ticks_of
from hil_bench.abilities.scenario.results import ScenarioResult
from hil_bench.abilities.scenario.verbs.machine_side import (
    Machine,
    check_consent,
    is_confirmed,
    load_machine,
    prepare_all,
)
from hil_bench.abilities.scenario.verbs.scenario_view import show_results
from hil_bench.cli.exit_codes import Ending, ExitCode, interrupted_once
from hil_bench.cli.results import is_silent
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel, Recording
from hil_drivers import BusLostError, DriverError

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
        with (
            watched_work(args, "test", title, channels) as view,
            _recorded(args, opened, channels, ending) as (recording, origin),
        ):
            samples = Samples(view, ShownRows(recording, view), origin, ending)
            if view.is_watched and opened.virtual is not None:
                hold_to_real_time(opened.virtual.session)
            show_results(view, results, len(chosen))
            for result in play_all(args, opened, machine, chosen, journal, samples):
                results.append(result)
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
    scenario = each.scenario
    return ScenarioResult(
        str(scenario.path),
        scenario.title,
        scenario.requirement_ids,
        machine.config.seed,
        dict(each.parameters),
        problem=problem,
    )
