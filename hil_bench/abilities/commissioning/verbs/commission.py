"""`hil-bench commission`: a plan's steps on an axis, its report and its recording."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from hil_bench import __version__
from hil_bench.abilities.commissioning.journal import SettingsJournal
from hil_bench.abilities.commissioning.measures import StepResult
from hil_bench.abilities.commissioning.plan import (
    CommissioningPlan,
    Step,
    check_against,
    choose_axis,
    load_plan,
)
from hil_bench.abilities.commissioning.report import ReportHead, write_report
from hil_bench.abilities.commissioning.session import (
    Commissioning,
    Console,
    commission,
    recorded_channels,
)
from hil_bench.abilities.commissioning.verbs.commission_settings import (
    ShownPlan,
    limits_text,
    open_journal,
    print_returned,
    restore,
    restore_command,
    result_text,
)
from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.controller_side import OpenNetwork, open_network
from hil_bench.abilities.common.files import make_directory
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.common.terminal import CLEARANCE, agrees
from hil_bench.abilities.common.work import (
    ShownRows,
    add_work_arguments,
    hold_to_real_time,
    watched_work,
)
from hil_bench.abilities.recording.options import recording_code, report_lines
from hil_bench.abilities.recording.report import RecordingReport
from hil_bench.abilities.recording.work import recorded_work
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli import arguments
from hil_bench.cli.exit_codes import Ending, ExitCode, interrupted_once, verdict_code, worst
from hil_bench.cli.parser import add_options, check_options
from hil_bench.cli.results import add_json_argument, is_silent, print_results
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.recording.channels import Channel

# Checks of `hil-bench commission` before it uses the bus.


def check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.machine and not args.virtual:
        raise ConfigError("--machine: is for a virtual machine; give --virtual too")
    if args.restore and args.virtual:
        raise ConfigError("--restore: a virtual machine is new in every run; give a bus")


def check_period(args: argparse.Namespace, plan: CommissioningPlan, machine: BenchConfig) -> None:
    """Refuse a plan whose samples fall between the moments that there are in virtual time.

    Raises:
        ConfigError: it says which period would be right.
    """
    if not (args.virtual or getattr(args, "lockstep", False)):
        return
    step = machine.tick_ns if args.virtual else machine.sync_period_ns
    name = "tick_us" if args.virtual else "sync_period_us"
    if round(plan.period * 1e9) % step:
        raise ConfigError(
            f"{plan.path}:plan.period_ms: {plan.period * 1e3:g} ms is not a multiple of "
            f"{name} = {step // 1000}; give one, or another {name}"
        )


def check_consent(args: argparse.Namespace, plan: CommissioningPlan) -> None:
    """Refuse a motion that nobody can be asked about, before anything is changed.

    Raises:
        ConfigError: there is nobody to ask.
    """
    has_motion = any(step.kind.moves for step in plan.steps)
    if has_motion and not (args.virtual or args.yes or sys.stdin.isatty()):
        raise ConfigError(
            "motion needs a confirmation, and this is no terminal; "
            "give --yes to move without asking"
        )


_EXAMPLES = """\
examples:
  hil-bench commission examples/commissioning.toml --virtual
  hil-bench commission plan.toml bench.toml -i socketcan -c can0
  hil-bench commission plan.toml bench.toml --virtual --machine other.toml    a dry run on a
                                                       virtual machine that differs from bench.toml
  hil-bench commission plan.toml -i socketcan -c can0 --panel                 with a web page: the
                                                       step, its limits, live values, stop
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "commission",
        description="Take an axis into operation step by step, on a machine or on the virtual\n"
        "bench: communication, sensors, direction, dead band, ramp, steps, frequency response,\n"
        "leakage. A step that leaves a limit closes the valve at once. Leaves a report and a\n"
        "recording.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "plan", type=Path, metavar="PLAN.toml", help="plan: steps, limits, tolerances"
    )
    arguments.add_bench_arguments(parser)
    common.add_network_arguments(parser)
    parser.add_argument(
        "--machine",
        metavar="FILE",
        help="with --virtual: the bench.toml of the machine, where it differs from the data sheet",
    )
    add_options("commission", parser)
    parser.add_argument(
        "--yes", action="store_true", help="move without asking; --virtual never asks"
    )
    parser.add_argument(
        "--restore",
        action="store_true",
        help="run no step: restore the devices' settings that a run which was killed has left "
        "changed, as its --output says",
    )
    common.add_output_argument(parser, "hil-bench-commissioning", "report and recording")
    add_json_argument(parser)
    add_units_argument(parser)
    add_work_arguments(parser, "commission")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the plan, write report and recording, print the verdicts.

    A bus that is lost is said last; the report shows how far the plan came.
    """
    check_arguments(args)
    check_options("commission", args)
    plan = load_plan(args.plan)
    if args.config is None and plan.bench is not None:
        args.config = str(plan.bench)
    bench = arguments.load_bench_config(args)
    config = common.seen_from_bus(args, bench)
    check_against(plan, choose_axis(plan, config))
    make_directory(args.output)
    machine = load_config(args.machine, seed=args.seed) if args.machine else bench
    check_period(args, plan, machine)
    if args.restore:
        with open_network(args, machine) as opened:
            return restore(args, opened)
    check_consent(args, plan)
    journal = open_journal(args)
    started = datetime.now(UTC)
    with open_network(args, machine) as opened:
        title, channels = f"{args.plan} on {opened.description}", _channels(plan, config)
        with watched_work(args, "commission", title, channels) as view:
            if view.is_watched and opened.virtual is not None:
                hold_to_real_time(opened.virtual.session)
            shown = ShownPlan(plan, choose_axis(plan, config).name, view)
            found, recorded = _commission(args, opened, config, plan, journal, shown)
    head = _head(args, opened, config, started, recorded)
    ending = Ending(args)
    paths: list[Path] = []
    with ending.going_on():
        paths = write_report(args.output, found, head)
    lines = [
        *(f"found     {item.name}: {item.evidence}; {item.mend}" for item in found.findings),
        f"verdict   {found.verdict}",
        *((f"report    {', '.join(map(str, paths))}",) if paths else ()),
        *report_lines(recorded),
    ]
    content = {
        "verdict": found.verdict,
        "steps": [_step_content(result) for result in found.results],
        "findings": found.findings,
        "report": paths,
        "recording": recorded,
    }
    with ending.going_on():
        print_results(args, lines, content)
    ending.take_error(BusError(found.lost) if found.lost else None)
    ending.take(recording_code(recorded), _verdict_code(found))
    return ending.code


def _verdict_code(found: Commissioning) -> ExitCode:
    code = verdict_code(
        fails=bool(found.returned.unrestored) or found.verdict == "failed", passes=found.passed
    )
    return worst(code, ExitCode.INTERRUPTED) if found.is_interrupted else code


def _commission(
    args: argparse.Namespace,
    opened: OpenNetwork,
    config: BenchConfig,
    plan: CommissioningPlan,
    journal: SettingsJournal,
    shown: ShownPlan,
) -> tuple[Commissioning, RecordingReport]:
    """Run the plan while all is recorded; return what was found, and what the recording holds."""
    work = Work("commission", len(plan.steps), "steps")

    def begin(step: Step) -> None:
        shown.begin(step)
        work.begin(str(step.kind))
        if not is_silent(args):
            _print_begin(step)

    def end(result: StepResult) -> None:
        shown.end(result)
        if not is_silent(args):
            _print_end(result)

    console = Console(
        confirm=lambda: args.virtual or args.yes or _confirmed(opened, plan, work),
        begin=begin,
        end=end,
        returned=lambda returned: print_returned(
            returned, restore_command(args), is_quiet=is_silent(args)
        ),
    )
    with (
        recorded_work(
            _recording_path(args), opened, _channels(plan, config), f"commissioning by {args.plan}"
        ) as (recording, origin),
        interrupted_once(),
        shown_work(args, work, pauses=not (args.json and (args.virtual or args.yes))),
    ):
        found = commission(
            opened.network,
            config,
            plan,
            console=console,
            recording=ShownRows(recording, shown.view),
            origin=origin,
            journal=journal,
        )
        shown.finish(found)
    return found, recording.report


def _channels(plan: CommissioningPlan, config: BenchConfig) -> Sequence[Channel]:
    return recorded_channels(choose_axis(plan, config).name)


def _recording_path(args: argparse.Namespace) -> Path:
    path: Path = args.output / "commissioning.mf4"
    return path


def _confirmed(opened: OpenNetwork, plan: CommissioningPlan, work: Work) -> bool:
    """Ask before the first motion."""
    work.is_waiting = True
    print(f"The axis on {opened.description} is going to move:", file=sys.stderr)
    for step in plan.steps:
        if step.kind.moves:
            print(f"  {step.kind}: {limits_text(step.limits)}", file=sys.stderr)
    try:
        return agrees(CLEARANCE, "yes")
    finally:
        work.is_waiting = False


def _print_begin(step: Step) -> None:
    print(f"{step.kind:14}", end="", flush=True)


def _print_end(result: StepResult) -> None:
    print(f"{result.verdict:8} {result_text(result)}".rstrip(), flush=True)


def _step_content(result: StepResult) -> dict[str, object]:
    """Return a step for a program, its numbers in SI units; its traces are in the recording."""
    return {
        "step": result.kind,
        "verdict": result.verdict,
        "problem": result.problem,
        "measures": [
            asdict(measure) | {"is_right": measure.is_right} for measure in result.measures
        ],
        "findings": [finding.name for finding in result.findings],
        "notes": result.notes,
        "duration": result.duration,
    }


def _head(
    args: argparse.Namespace,
    opened: OpenNetwork,
    config: BenchConfig,
    started: datetime,
    recorded: RecordingReport,
) -> ReportHead:
    losses = [f"{recorded.lost} messages left out"] if recorded.lost else []
    return ReportHead(
        "Commissioning report",
        {
            "date": f"{started:%Y-%m-%d %H:%M:%S} UTC",
            "plan": str(args.plan),
            "data sheet": str(config.path or "built-in bench"),
            "bus": opened.description + (f" ({args.machine})" if args.machine else ""),
            "versions": f"hil-bench {__version__}, python-can {version('python-can')}, "
            f"canopen {version('canopen')}, Python {python_version()}",
            "recording": "; ".join((_recording_path(args).name, *losses, *recorded.problems)),
        },
    )
