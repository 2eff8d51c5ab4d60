"""Verbosity of a verb: -v and -q, which may stand before the verb and after it."""

import argparse


def add_verbosity_arguments(
    parser: argparse.ArgumentParser, *, verbose: int | str, quiet: bool | str
) -> None:
    """Add -v and -q with their defaults; `argparse.SUPPRESS` leaves what an outer parser set."""
    parser.add_argument(
        "-v",
        "--verbose",
        action="count",
        default=verbose,
        help="print more; twice: all, with the traceback of an error",
    )
    parser.add_argument(
        "-q",
        "--quiet",
        action="store_true",
        default=quiet,
        help="print only errors, and the output of --json, --csv and the like",
    )


def add_verbosity_below(parser: argparse.ArgumentParser) -> None:
    """Add -v and -q to the parser of a verb, and to those of the words that may follow it."""
    add_verbosity_arguments(parser, verbose=argparse.SUPPRESS, quiet=argparse.SUPPRESS)
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list of them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for below in action.choices.values():
                add_verbosity_below(below)
