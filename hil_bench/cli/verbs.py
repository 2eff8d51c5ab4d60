"""The verbs of the command line, of the core and of abilities, and options that abilities add."""

import argparse
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import ModuleType

from hil_bench.ability import GROUPS, Verb, other_abilities, own_abilities
from hil_bench.cli.exit_codes import ExitCode

# The verbs of the command line: the core's own, and those of the abilities.

CORE = {
    "check": Verb(
        "start",
        30,
        "check a bench.toml, and print each value with its origin",
        "hil_bench.cli.check",
    ),
    "devices": Verb(
        "start", 40, "print the device table: node-IDs, profiles, PDOs", "hil_bench.cli.devices"
    ),
    "run": Verb("run", 10, "run the bench in real time on a CAN bus", "hil_bench.cli.run"),
    "completion": Verb(
        "more",
        40,
        "print the script by which a shell completes verbs and options",
        "hil_bench.cli.verbs",
    ),
}
"""The verbs of the core."""


def own_verbs() -> dict[str, Verb]:
    """Every verb of the bench itself."""
    return _in_order(
        CORE | {name: verb for each in own_abilities() for name, verb in each.verbs.items()}
    )


def all_verbs() -> tuple[dict[str, Verb], list[str]]:
    """Every verb, those of other distributions included, and a line for each problem of these."""
    verbs = own_verbs()
    others, problems = other_abilities()
    for ability in others:
        for name, verb in ability.verbs.items():
            if name in verbs:
                there = f"is there already, in {verbs[name].module}"
                problems.append(f"ability {ability.name}: its verb {name} {there}; rename it")
            else:
                verbs[name] = verb
    return _in_order(verbs), problems


def _in_order(verbs: Mapping[str, Verb]) -> dict[str, Verb]:
    by_place = sorted(verbs.items(), key=lambda item: (GROUPS.index(item[1].group), item[1].place))
    return dict(by_place)


# The options that abilities add to verbs of the core, or of one another.


def add_options(
    verb: str, parser: argparse.ArgumentParser, often: "argparse._ActionsContainer | None" = None
) -> None:
    """Add the options of all abilities to a verb.

    Args:
        verb: its name.
        parser: takes the options.
        often: the group of those that are most used; None where the verb has no groups.
    """
    for module in _modules(verb):
        module.add_options(parser, parser if often is None else often)
        if parser.epilog:
            parser.epilog += getattr(module, "EXAMPLES", {}).get(verb, "")


def check_options(verb: str, args: argparse.Namespace) -> None:
    """Let each ability refuse what cannot be meant of its options, by a `ConfigError`.

    Args:
        verb: to which they were added.
        args: the command line.
    """
    for module in _modules(verb):
        if check := getattr(module, "check_options", None):
            check(args)


def take_over(verb: str, args: argparse.Namespace, *known: object) -> int | None:
    """Run a verb as the ability whose options are given; None where none is.

    Args:
        verb: to which they were added.
        args: the command line.
        known: what the verb has read of it by now.
    """
    modules = (module for module in _modules(verb) if hasattr(module, "take_over"))
    codes = (module.take_over(args, *known) for module in modules)
    return next((code for code in codes if code is not None), None)


def _modules(verb: str) -> Iterator[ModuleType]:
    for ability in own_abilities():
        if verb in ability.options:
            yield import_module(ability.options[verb])


# `hil-bench completion`: have a shell complete verbs and options.

SHELLS = ("bash", "zsh", "tcsh")

_EXAMPLES = """\
examples:
  hil-bench completion bash > ~/.local/share/bash-completion/completions/hil-bench
  hil-bench completion zsh > ~/.zfunc/_hil-bench                with ~/.zfunc in fpath
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "completion",
        description="Print a script by which a shell completes verbs and options.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab  # noqa: PLC0415 - of this verb alone

    from hil_bench.cli import build_parser  # noqa: PLC0415 - it imports this module

    verbs, _ = all_verbs()
    sys.stdout.write(shtab.complete(build_parser(verbs, verbs), args.shell))
    return ExitCode.DONE
