"""Checks of `hil-bench commission` before it uses the bus."""

import argparse
import sys

from hil_bench.abilities.commissioning.plan import CommissioningPlan
from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import ConfigError


def check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.machine and not args.virtual:
        raise ConfigError("--machine: is for a virtual machine; give --virtual too")
    if args.lockstep and args.virtual:
        raise ConfigError("--lockstep: --virtual has virtual time already; give one of both")
    if args.sync_period_us is not None and not args.lockstep:
        raise ConfigError("--sync-period-us: belongs to --lockstep; give both")
    if args.restore and args.virtual:
        raise ConfigError("--restore: a virtual machine is new in every run; give a bus")


def check_period(args: argparse.Namespace, plan: CommissioningPlan, machine: BenchConfig) -> None:
    """Refuse a plan whose samples fall between the moments that there are in virtual time.

    Raises:
        ConfigError: it says which period would be right.
    """
    if not (args.virtual or args.lockstep):
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
