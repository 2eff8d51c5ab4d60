"""A parser that takes positional arguments anywhere, and says in one line what is wrong."""

import argparse
import difflib
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.help_format import HelpFormatter

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
            near = difflib.get_close_matches(name, self._option_string_actions, n=1)
            if name.startswith("-") and near:
                self.error(f"{name} is unknown; did you mean {near[0]}?")
        if rest:
            self.error(f"{' '.join(rest)}: unknown")
        return parsed, rest

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse what is no choice.

        Raises:
            argparse.ArgumentError: with the nearest choice, or all where they are few.
        """
        known = [str(choice) for choice in action.choices or ()]
        if action.choices is None or value in action.choices:
            return
        near = difflib.get_close_matches(str(value), known, n=1)
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
