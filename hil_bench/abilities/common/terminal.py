"""A running bench for a terminal: in words, in tables and bars; by the library rich, an extra."""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hil_bench.canopen_device.words import can_text
from hil_bench.errors import ConfigError, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_BAR = 20

_BLOCKS = " ▏▎▍▌▋▊▉█"

ONCE = 2.0
"""The time that a bus is listened to for one picture [s]; most heartbeats come once a second."""

REFRESH = 0.1
"""Time between two pictures [s]."""

STATE_STYLES = {"OPERATIONAL": "green", "PRE-OPERATIONAL": "yellow", "STOPPED": "red"}
"""Colours of NMT states."""


CLEARANCE = "Is the area clear, and the emergency stop at hand? Type yes to move: "
"""The question before a machine moves."""


def make_console(*, once: bool) -> "Console":
    """Return the terminal, or whatever standard output is.

    Args:
        once: whether one picture is drawn, which needs no terminal.

    Raises:
        ConfigError: the library that draws is missing, or nothing can be drawn anew here.
    """
    try:
        from rich.console import Console  # noqa: PLC0415 - it is an extra
    except ImportError:
        raise ConfigError(
            "watch needs rich, which is missing; pip install 'hil-bench[watch]'"
        ) from None
    # Device names are texts from outside: no markup, no emoji, no guessed colours.
    console = Console(markup=False, emoji=False, highlight=False)
    if not once and (not console.is_terminal or console.is_dumb_terminal):
        raise ConfigError("watch draws on a terminal, which this is not; --once prints one picture")
    return console


def agrees(question: str, *words: str) -> bool:
    """Ask on the terminal; return True for one of the words, False also where the input ends."""
    try:
        return input(question).strip().lower() in words
    except EOFError:
        sys.stdout.write("\n")  # as the terminal shows none
        return False


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


def node_text(node: Mapping[str, Any]) -> str:
    """Return the state of a node in words."""
    device = f", {node['device']}" if node["device"] else ""
    errors = "".join(f", EMCY 0x{code:04X}" for code in node["errors"])
    can = f", {can_text(node['can'])}" if "can" in node else ""
    foreign = f", {node['foreign']} frames of another one" if "foreign" in node else ""
    return printable(f"{node['state']}{device}{errors}{can}{foreign}")


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


_COUNTS = {
    "overruns": "overran",
    "skipped": "skipped",
    "syncs": "SYNCs",
    "received": "in",
    "sent": "out",
}
