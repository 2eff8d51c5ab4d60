"""The settings of `hil-bench commission`, and its view on a feed."""

import argparse
import shlex
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from hil_bench.abilities.commissioning.journal import BorrowedSetting, Returned, SettingsJournal
from hil_bench.abilities.commissioning.measures import StepResult
from hil_bench.abilities.commissioning.plan import CommissioningPlan, Limits, Step
from hil_bench.abilities.commissioning.session import Commissioning
from hil_bench.abilities.common.arguments import bus_words
from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.abilities.common.shown_units import shown_unit
from hil_bench.abilities.common.work import WorkItem, WorkView
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_drivers import NmtState

# The lines of `hil-bench commission` on the settings that it changed, and `--restore`.

_FILE = "unrestored.jsonl"


def open_journal(args: argparse.Namespace) -> SettingsJournal:
    """Return the journal of a run; a virtual machine needs no file, it is gone with its process.

    Raises:
        ConfigError: an earlier run has left settings changed.
    """
    if args.virtual:
        return SettingsJournal()
    path = journal_path(args)
    if path.exists():
        raise ConfigError(
            f"{path}: an earlier run was ended before it could restore these settings; "
            f"restore them: {restore_command(args)} (or remove the file)"
        )
    return SettingsJournal(path)


def journal_path(args: argparse.Namespace) -> Path:
    """Return the file that holds what is not restored yet."""
    path: Path = args.output / _FILE
    return path


def restore_command(args: argparse.Namespace) -> str:
    """Return the command that restores what is left changed."""
    words = ["hil-bench", "commission", str(args.plan)]
    words += [args.config] if args.config else []
    words += bus_words(args)
    words += ["--lockstep"] if getattr(args, "lockstep", False) else []
    return shlex.join([*words, "--output", str(args.output), "--restore"])


def restore(args: argparse.Namespace, opened: OpenNetwork) -> int:
    """Restore what an earlier run has left changed."""
    journal = SettingsJournal.read(journal_path(args))
    journal.restore(opened.network)
    print_returned(Returned(tuple(journal.settings)), restore_command(args))
    return ExitCode.CHECK_FAILED if journal.unrestored else ExitCode.DONE


def print_returned(returned: Returned, command: str, *, is_quiet: bool = False) -> None:
    """Say what was changed and is restored; on standard error what is not, with a command."""
    settings = returned.settings
    if settings and not is_quiet and not returned.unrestored:
        print(f"settings  restored: {len(settings)} of {_nodes(settings)}")
    for line in _state_lines(returned) if not is_quiet else ():
        print(line)
    for line in _unrestored_lines(returned.unrestored, command):
        print(line, file=sys.stderr)


def _nodes(settings: Sequence[BorrowedSetting]) -> str:
    numbers = sorted({setting.node_id for setting in settings})
    return f"node{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def _state_lines(returned: Returned) -> Iterator[str]:
    """Yield how the nodes were left."""
    texts = {
        NmtState.PRE_OPERATIONAL: "PRE-OPERATIONAL again",
        NmtState.OPERATIONAL: "OPERATIONAL, as before",
        None: "left OPERATIONAL; how they were before they do not say",
    }
    for state, text in texts.items():
        nodes = [
            str(node_id) for node_id, found in sorted(returned.states.items()) if found is state
        ]
        if nodes:
            yield f"nodes     {', '.join(nodes)}: {text}"


def _unrestored_lines(settings: Sequence[BorrowedSetting], command: str) -> Iterator[str]:
    ordered = sorted(settings, key=lambda setting: (setting.node_id, setting.problem))
    for (node_id, problem), group in groupby(ordered, lambda s: (s.node_id, s.problem)):
        of_node = list(group)
        yield f"settings  not restored: {len(of_node)} of node {node_id}: {problem}"
        for setting in of_node:
            was, wrote = setting.text(setting.before), setting.text(setting.during)
            yield f"          {setting}: was {was}, may be {wrote}"
    if settings:
        yield f"          mend: {command}"
        yield "          or power-cycle the device, which brings back what it has stored"


# A commissioning as those see it who watch, and its steps and results in words.


class ShownPlan:
    """A plan as those see it who watch.

    Args:
        plan: the steps.
        axis: the name of the axis.
        view: where it is shown.

    Attributes:
        view: as passed in.
    """

    def __init__(self, plan: CommissioningPlan, axis: str, view: WorkView) -> None:
        self.view = view
        self._axis = axis
        self._steps = plan.steps
        self._results: list[StepResult] = []
        view.show(total=len(plan.steps), items=self._items())

    def begin(self, step: Step) -> None:
        """Show the step that begins, with its limits."""
        self.view.show(
            now=str(step.kind),
            detail=limits_text(step.limits),
            limits=limits_by_channel(self._axis, step.limits),
            items=self._items(is_running=True),
        )

    def end(self, result: StepResult) -> None:
        """Show what came of a step."""
        self._results.append(result)
        self.view.show(
            now="",
            detail="",
            limits={},
            done=len(self._results),
            counts=Counter(str(each.verdict) for each in self._results),
            items=self._items(),
        )

    def finish(self, found: Commissioning) -> None:
        """Show what came of all."""
        self.view.show(verdict=found.verdict)

    def _items(self, *, is_running: bool = False) -> list[WorkItem]:
        done = [
            WorkItem(
                str(each.kind),
                str(each.verdict),
                "; ".join(filter(None, [result_text(each), *(f.name for f in each.findings)])),
            )
            for each in self._results
        ]
        left = [
            WorkItem(str(step.kind), "", limits_text(step.limits))
            for step in self._steps[len(done) :]
        ]
        if is_running:
            left[0] = left[0]._replace(verdict="runs")
        return done + left


def limits_by_channel(axis: str, limits: Limits) -> dict[str, tuple[float, float]]:
    """Return lowest and highest value, in SI, of each channel of an axis that has limits."""
    return {
        f"{axis}.position": limits.position,
        f"{axis}.speed": (-limits.speed, limits.speed),
        f"{axis}.{P_A}": limits.pressure,
        f"{axis}.{P_B}": limits.pressure,
    }


def limits_text(limits: Limits) -> str:
    """Return limits in words."""
    length, speed, pressure = (shown_unit(symbol) for symbol in ("m", "m/s", "Pa"))
    parts = [
        f"position {length.range_text(*limits.position)}",
        f"speed to {speed.short(limits.speed)}",
        f"pressure {pressure.range_text(*limits.pressure)}",
        f"time to {limits.time:g} s",
    ]
    if limits.contact_speed is not None:
        parts.append(f"contact to {speed.short(limits.contact_speed)}")
    return ", ".join(parts)


def result_text(result: StepResult) -> str:
    """Return the problems of a step's result."""
    wrong = [
        f"{measure.name} {measure.text()} ({measure.range_text()} is right)"
        for measure in result.measures
        if not measure.is_right
    ]
    return "; ".join(filter(None, [result.problem, *wrong]))
