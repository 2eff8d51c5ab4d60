"""How much a verb says: -v and -q, which may stand before the verb and after it."""

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
        help="say more; twice: all, with the traceback of an error",
    )
    parser.add_argument(
        "-q", "--quiet", action="store_true", default=quiet, help="say nothing but errors"
    )
