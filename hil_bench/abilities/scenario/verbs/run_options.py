"""The options of `hil-bench run` for scenarios; nothing here imports their player."""

import argparse
from pathlib import Path

from hil_bench.abilities.scenario.verbs.scenario_arguments import add_parameter_argument, has_bus
from hil_bench.errors import ConfigError

EXAMPLES = {
    "run": """\
  hil-bench run --scenario examples/scenarios/settling.scenario.toml
                                       in real time, for people who watch; then the verdicts
  hil-bench run --scenario sag.scenario.toml -i socketcan -c can0
                                       the same, driven by the controller on the bus
"""
}

_NEVER = ("config", "duration", "lockstep", "fault")
_WITH_A_BUS = (
    "modbus",
    "strict_timing",
    "histograms",
    "realtime",
    "realtime_priority",
    "realtime_cpu",
    "realtime_spin_us",
    "overrun",
    "whole_bus",
    "hub_unlimited",
)
_INSTEAD = {
    "config": ("bench.toml", "the scenario names its bench"),
    "duration": ("--duration", "the scenario has its duration_s"),
    "lockstep": ("--lockstep", "give [controller] firmware in the scenario"),
    "fault": ("--fault", "make it a step of the scenario"),
}


def add_options(_: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add what concerns a bench that plays a scenario."""
    often.add_argument(
        "--scenario",
        type=Path,
        metavar="FILE",
        help="play a scenario, print its verdicts and end (docs/scenarios.md); without a bus its "
        "own controller drives, with one the controller there",
    )
    add_parameter_argument(often)


def take_over(args: argparse.Namespace) -> int | None:
    """Play a scenario in place of a run where one is given."""
    if args.scenario is None:
        return None
    from hil_bench.abilities.scenario.verbs import scenario_run  # noqa: PLC0415 - brings much

    return scenario_run.run(args)


def check_options(args: argparse.Namespace) -> None:
    """Refuse what does not go with a scenario.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.scenario is None:
        if args.given:
            raise ConfigError("--set: gives a parameter of a scenario; give --scenario FILE too")
        return
    for name in _NEVER:
        if getattr(args, name, None):
            option, right = _INSTEAD[name]
            raise ConfigError(f"{option}: not with --scenario; {right}")
    for name in () if has_bus(args) else _WITH_A_BUS:
        if getattr(args, name, None):
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"{option}: belongs to a bus; give -i and -c or --hub too")
