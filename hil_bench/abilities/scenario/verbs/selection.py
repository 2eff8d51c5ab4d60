"""`-k`: which requirements of which scenarios are chosen, prepared one after the other."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.on_machine import MachineScenario
from hil_bench.abilities.scenario.prepared import PreparedScenario
from hil_bench.abilities.scenario.records import Scenario
from hil_bench.errors import ConfigError

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
