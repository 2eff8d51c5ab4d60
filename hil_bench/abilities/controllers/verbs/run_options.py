"""`hil-bench run --controller`: a controller in the process of the bench."""

import argparse
from pathlib import Path

from hil_bench.cli.arguments import parse_value
from hil_bench.errors import ConfigError


def add_options(_: argparse.ArgumentParser, often: "argparse._ActionsContainer") -> None:
    """Add what puts a controller on the buses of the bench."""
    often.add_argument(
        "--controller",
        nargs="+",
        action="append",
        default=[],
        metavar="WORD",
        help="controller as KIND [KEY=VALUE ...], as in 'python call=axis.py:control'; repeat it "
        "for more (docs/firmware.md)",
    )


def take_over(args: argparse.Namespace) -> None:
    """Make tables of ``[controllers.NAME]`` of the words; the verb itself goes on.

    Raises:
        ConfigError: they are not KIND [KEY=VALUE ...].
    """
    if not args.controller:
        return
    tables: dict[str, object] = {}
    for kind, *words in args.controller:
        pairs = [word.partition("=") for word in words]
        if "=" in kind or not all(sign for _, sign, _ in pairs):
            right = "give KIND [KEY=VALUE ...], as in python call=axis.py:control"
            raise ConfigError(f"--controller {' '.join((kind, *words))}: is no controller; {right}")
        count = sum(name.startswith(kind) for name in tables)
        given = {key: parse_value(value) for key, _, value in pairs}
        name = f"{kind}{count + 1}" if count else kind
        tables[name] = {"kind": kind, "folder": str(Path.cwd()), **given}
    args.tables = {"controllers": tables}
