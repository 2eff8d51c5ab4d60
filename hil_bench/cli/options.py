"""The options that abilities add to the verbs of the core."""

import argparse
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from hil_bench.ability import own_abilities


def add_options(verb: str, group: "argparse._ActionsContainer") -> None:
    """Add the options of all abilities to a verb of the core."""
    for module in _modules(verb):
        module.add_options(group)


def take_over(verb: str, args: argparse.Namespace, *known: object) -> int | None:
    """Run a verb as the ability whose options are given; None where none is.

    Args:
        verb: of the core.
        args: the command line.
        known: what the verb has read of it by now.
    """
    codes = (module.take_over(args, *known) for module in _modules(verb))
    return next((code for code in codes if code is not None), None)


def _modules(verb: str) -> Iterator[ModuleType]:
    for ability in own_abilities():
        if verb in ability.options:
            yield import_module(ability.options[verb])
