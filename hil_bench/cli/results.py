"""Output of a verb: lines for people, tables for a terminal, JSON for a program."""

import argparse
import json
import logging
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any

from hil_bench.canopen_device.words import can_text
from hil_bench.errors import ConfigError, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

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


# A running bench for a terminal: in words, in tables and bars.


# Tables and bars for a terminal, by the library rich, which is an extra.

_BAR = 20
_BLOCKS = " ▏▎▍▌▋▊▉█"

ONCE = 2.0
"""The time that a bus is listened to for one picture [s]; most heartbeats come once a second."""

REFRESH = 0.1
"""Time between two pictures [s]."""

STATE_STYLES = {"OPERATIONAL": "green", "PRE-OPERATIONAL": "yellow", "STOPPED": "red"}
"""Colours of NMT states."""


def make_console() -> "Console":
    """Return the terminal.

    Raises:
        ConfigError: the library that draws is missing.
    """
    try:
        from rich.console import Console  # noqa: PLC0415 - it is an extra
    except ImportError:
        raise ConfigError(
            "watch needs rich, which is missing; pip install 'hil-bench[watch]'"
        ) from None
    # Device names are texts from outside: no markup, no emoji, no guessed colours.
    return Console(markup=False, emoji=False, highlight=False)


def bar(value: float | None, low: float, high: float, width: int = _BAR) -> str:
    """Return a bar that is as full as the value lies between the two; empty where they are one."""
    if value is None or not low < high:
        return " " * width
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    eighths = round(share * width * 8)
    full, rest = divmod(eighths, 8)
    return ("█" * full + (_BLOCKS[rest] if rest else "")).ljust(width)


def make_table(*heads: str, right: tuple[int, ...] = ()) -> "Table":
    """Return an empty table.

    Args:
        heads: of its columns.
        right: the columns that are aligned right.
    """
    from rich.table import Table  # noqa: PLC0415 - it is an extra

    table = Table(box=None, header_style="dim", pad_edge=False)
    for number, head in enumerate(heads):
        table.add_column(head, no_wrap=True, justify="right" if number in right else "left")
    return table


# A running bench in words: states, the loop, values in the units that people use.


def node_text(node: Mapping[str, Any]) -> str:
    """Return the state of a node in words."""
    device = f", {node['device']}" if node["device"] else ""
    errors = "".join(f", EMCY 0x{code:04X}" for code in node["errors"])
    can = f", {can_text(node['can'])}" if "can" in node else ""
    foreign = f", {node['foreign']} frames of another one" if "foreign" in node else ""
    return printable(f"{node['state']}{device}{errors}{can}{foreign}")


def ecu_text(ecu: Mapping[str, Any]) -> str:
    """Return the state of a J1939 device in words."""
    address = f", address {ecu['address']}" if ecu["state"] in _WITH_ADDRESS else ""
    codes = "".join(f", SPN {spn} FMI {fmi}" for spn, fmi in ecu["codes"])
    can = f", {can_text(ecu['can'])}" if "can" in ecu else ""
    return printable(f"{ecu['state']}{address}{codes}{can}")


def health_text(health: Mapping[str, Any]) -> str:
    """Return in words how the loop and the bus are."""
    parts = []
    for name, key in (("late", "lateness"), ("work", "work")):
        if key in health:
            times = health[key]
            parts.append(f"{name} p99 {times['p99_us']:.0f} max {times['max_us']:.0f} us")
    parts += [f"{health[key]} {word}" for key, word in _COUNTS.items() if key in health]
    if "bus_load" in health:
        parts.append(f"bus {health['bus_load'] * 100:.1f} %")
    return "  ".join(parts)


_WITH_ADDRESS = ("claiming", "claimed")

_COUNTS = {
    "overruns": "overran",
    "skipped": "skipped",
    "syncs": "SYNCs",
    "received": "in",
    "sent": "out",
}
