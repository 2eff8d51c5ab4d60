"""Tables and bars for a terminal, by the library rich, which is an extra."""

from typing import TYPE_CHECKING

from hil_bench.errors import ConfigError

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
