"""The command line: its verbs, its parser and its help."""

import argparse
import sys
import textwrap
from collections.abc import Generator, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import groupby
from types import ModuleType
from typing import Any, NoReturn

from hil_bench.ability import GROUPS, Verb, other_abilities, own_abilities
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.config.values import close_names

# The help of a verb on a narrow terminal: descriptions and examples as written, where they fit.

_COMMENT_INDENT = 8  # of an example's comment that has no room behind its command
_FAR = 20  # leading spaces of a line that goes on with the comment above


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Wraps what is wider than the terminal, and leaves the rest as it is."""

    def _iter_indented_subactions(
        self, action: argparse.Action
    ) -> Generator[argparse.Action, None, None]:
        # Verbs stand below the headings of their groups.
        headings = getattr(action, "headings", None)
        if headings is None:
            yield from super()._iter_indented_subactions(action)
            return
        widest = (
            self._current_indent + 2 * self._indent_increment + max(map(len, action.choices or ()))
        )
        self._action_max_length = max(self._action_max_length, widest)
        yield from headings

    def _format_action(self, action: argparse.Action) -> str:
        if getattr(action, "headings", None) is None:
            return super()._format_action(action)
        # Without a line of its own, which would say no more than VERB.
        return "".join(map(self._format_action, self._iter_indented_subactions(action)))

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines: list[str] = []
        for is_indented, group in groupby(text.splitlines(), key=lambda line: line[:1] == " "):
            block = list(group)
            if max(map(len, block)) <= width:
                lines += block
            elif is_indented:
                lines += _wrapped_examples(block, width)
            else:
                lines += _wrapped_paragraphs(block, width)
        return "\n".join(indent + line for line in lines)


def _wrapped_paragraphs(block: list[str], width: int) -> Iterator[str]:
    for is_text, group in groupby(block, key=bool):
        if is_text:
            yield from textwrap.wrap(" ".join(group), width, break_on_hyphens=False)
        else:
            yield from group


def _wrapped_examples(block: list[str], width: int) -> Iterator[str]:
    """Yield examples, the comment of each on lines of its own where one does not fit."""
    gap = " " * _COMMENT_INDENT
    for line in block:
        start = len(line) - len(line.lstrip())
        command, _, comment = line[start:].partition("   ")
        if start >= _FAR:
            start, command, comment = 0, "", line
        if command.startswith("hil-bench"):
            yield " " * start + command  # in one piece, to be copied
        elif command:
            further = " " * (start + 2)
            yield from textwrap.wrap(" " * start + command, width, subsequent_indent=further)
        if comment.strip():
            yield from textwrap.wrap(
                comment.strip(), width, initial_indent=gap, subsequent_indent=gap
            )


# A parser that takes positional arguments anywhere, and says in one line what is wrong.

_MOST_CHOICES = 8  # more of them are for --help


class Parser(argparse.ArgumentParser):
    """An argument parser for people: errors of one line, with the nearest name that is right.

    Its description and its epilog stand as they are written, where the terminal is wide enough.

    It leaves an optional positional for the arguments that stand behind an option. In
    ``FILE --virtual bench.toml`` Python before 3.12.7 has bench.toml's place empty as soon as it
    has seen FILE, and refuses bench.toml then.
    """

    def __init__(self, **options: Any) -> None:  # noqa: ANN401 - as argparse
        super().__init__(**{"formatter_class": HelpFormatter, **options})

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and where help is, without the usage of all options, and exit."""
        print(f"hil-bench: error: {message}; see: {self.prog} --help", file=sys.stderr)
        self.exit(ExitCode.USAGE)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse, and refuse an unknown option here, where its nearest relative is known."""
        parsed, rest = super().parse_known_args(args, namespace)
        for word in rest:
            name = word.partition("=")[0]
            near = close_names(name, self._option_string_actions)
            if name.startswith("-") and near:
                self.error(f"{name} is unknown; did you mean {near[0]}?")
        if rest and rest[0].startswith("-"):
            self.error(f"{' '.join(rest)}: unknown")
        if rest:
            taken = [str(each.metavar or each.dest) for each in self._get_positional_actions()]
            right = f"{' '.join(taken)}, and options" if taken else "options alone"
            self.error(f"{' '.join(rest)}: too many; {self.prog} takes {right}")
        return parsed, rest

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse what is no choice.

        Raises:
            argparse.ArgumentError: with the nearest choice, or all where they are few.
        """
        known = [str(choice) for choice in action.choices or ()]
        if action.choices is None or value in action.choices:
            return
        near = close_names(str(value), known)
        if near:
            right = f"did you mean {near[0]}?"
        else:
            right = ", ".join(known[:_MOST_CHOICES]) + (", ..." * (len(known) > _MOST_CHOICES))
            right += " are right" if len(known) > 1 else " is right"
        raise argparse.ArgumentError(action, f"{value!r} is unknown; {right}")

    def _match_arguments_partial(
        self, actions: Sequence[argparse.Action], arg_strings_pattern: str
    ) -> list[int]:
        counts = super()._match_arguments_partial(actions, arg_strings_pattern)
        has_more = "A" in arg_strings_pattern[sum(counts) :]  # "A" for argument, "O" for option
        while has_more and counts and counts[-1] == 0:
            counts.pop()
        return counts


# The verbs of the command line, of the core and of abilities, and options that abilities add.


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
        "hil_bench.cli.parser",
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
