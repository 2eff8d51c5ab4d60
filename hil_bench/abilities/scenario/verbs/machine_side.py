"""The machine side of `hil-bench test`: arguments, limits, consent."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from hil_bench.abilities.commissioning.measures import SAMPLE_CHANNELS
from hil_bench.abilities.commissioning.plan import (
    CommissioningPlan,
    Limits,
    check_against,
    choose_axis,
    load_plan,
)
from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.abilities.common.members import Members, find_members
from hil_bench.abilities.common.terminal import CLEARANCE, agrees
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.recorded import MachineScenario, prepare_for_machine
from hil_bench.abilities.scenario.records import Scenario
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.arguments import add_bus_arguments, load_bench_config
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

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
    chosen, wrong = [], []
    for path in paths:
        try:
            prepared = prepare(load_scenario(path))
        except ConfigError as error:
            wrong.append(str(error))
            continue
        requirements = tuple(
            each
            for each in prepared.requirements
            if args.k.lower() in f"{path}\n{prepared.scenario.title}\n{each.id}".lower()
        )
        if requirements:
            chosen.append(replace(prepared, requirements=requirements))
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
