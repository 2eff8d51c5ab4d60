"""Output of a verb: lines for people, tables for a terminal, JSON for a program."""

import argparse
import json
import logging
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import Any

from hil_bench.canopen_device.words import can_text
from hil_bench.errors import printable

# Output of a verb: lines for people, JSON for a program, or nothing under --quiet.
#
# Under -q no verb prints anything but errors. What an option asks for a program is printed all the
# same: --json, --csv, a schema, a completion script.


def add_json_argument(parser: "argparse._ActionsContainer", *, default: bool | str = False) -> None:
    """Add --json; `argparse.SUPPRESS` as its default leaves what an outer parser set."""
    parser.add_argument(
        "--json", action="store_true", default=default, help="print JSON, for programs"
    )


def is_silent(args: argparse.Namespace) -> bool:
    """Return True if a verb must print nothing while it works."""
    return bool(args.quiet or args.json)


def print_lines(args: argparse.Namespace, *lines: str) -> None:
    """Print lines for people, which may quote anything, and none under --quiet."""
    if lines and not args.quiet:
        texts = (part for line in lines for part in line.split("\n"))
        print(*map(printable, texts), sep="\n", flush=True)


def print_results(
    args: argparse.Namespace, lines: Iterable[str], content: Mapping[str, object]
) -> None:
    """Print what a verb found.

    Args:
        args: of the command line, with `json` and `quiet`.
        lines: for people.
        content: the same for a program: records, paths, numbers in SI units.
    """
    if args.json:
        print(json_text(content))
    else:
        print_lines(args, *lines)
    sys.stdout.flush()  # before an error may follow on standard error


def json_text(content: object, *, indent: int | None = 2) -> str:
    """Return JSON of what `plain` makes plain, with escapes of what no terminal shows."""
    text = json.dumps(plain(content), indent=indent, ensure_ascii=False, allow_nan=False)
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text)


def plain(value: object) -> object:
    """Convert a value to one that JSON can hold: null where a number is NaN or infinite."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    return [plain(item) for item in value] if isinstance(value, Iterable) else str(value)


# Warnings about implausible values of a bench, given once.

logger = logging.getLogger(__name__)


def warn_of(doubts: Sequence[str]) -> None:
    """Say doubts on standard error, a line each; -q leaves them out."""
    for doubt in doubts:
        logger.warning("warning: %s", doubt)


def ecu_text(ecu: Mapping[str, Any]) -> str:
    """Return the state of a J1939 device in words."""
    address = f", address {ecu['address']}" if ecu["state"] in _WITH_ADDRESS else ""
    codes = "".join(f", SPN {spn} FMI {fmi}" for spn, fmi in ecu["codes"])
    can = f", {can_text(ecu['can'])}" if "can" in ecu else ""
    return printable(f"{ecu['state']}{address}{codes}{can}")


_WITH_ADDRESS = ("claiming", "claimed")
