"""The values of a bench as tables for a terminal: one axis in a column, several side by side."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from hil_bench.errors import printable
from hil_bench.shown_units import shown_unit

if TYPE_CHECKING:
    from rich.table import Table

_BAR = 20
_BLOCKS = " ▏▎▍▌▋▊▉█"

Channels = Sequence[tuple[str, str]]
"""Names and SI units."""


class Values:
    """The newest values of some channels, with the lowest and highest of each.

    Args:
        channels: of the bench.
    """

    def __init__(self, channels: Channels) -> None:
        self.channels = channels
        self._latest: dict[str, float | None] = {}
        self._ranges: dict[str, tuple[float, float]] = {}

    def take(self, row: Sequence[float | None]) -> None:
        """Take a row: the time, then a value a channel."""
        names = ["time", *(name for name, _ in self.channels)]
        self._latest = dict(zip(names, row, strict=True))
        for name, value in self._latest.items():
            if value is not None:
                low, high = self._ranges.get(name, (value, value))
                self._ranges[name] = (min(low, value), max(high, value))

    @property
    def time(self) -> float:
        """Time of the newest row [s]; 0 without any."""
        return self._latest.get("time") or 0.0

    def tables(
        self, axes: Sequence[str], limits: Mapping[str, Sequence[float | None]]
    ) -> Iterator["Table"]:
        """Yield the tables: with several axes, one with a row an axis, then one of the rest.

        Args:
            axes: names of the axes.
            limits: lowest and highest right value of channels [SI]; None without one.

        Yields:
            Each table.
        """
        owned = {axis: self._owned(axis) for axis in axes}
        rest = list(self.channels)
        if sum(map(bool, owned.values())) > 1:
            rest = [each for each in rest if each[0].rpartition(".")[0] not in owned]
            alike: dict[Channels, list[str]] = {}
            for axis, channels in owned.items():
                alike.setdefault(tuple(channels), []).append(axis)
            for channels, names in alike.items():
                yield self._matrix(channels, names)
        if rest:
            yield self._column(rest, limits)

    def _owned(self, axis: str) -> Channels:
        parts = ((name.rpartition("."), unit) for name, unit in self.channels)
        return [(quantity, unit) for (owner, _, quantity), unit in parts if owner == axis]

    def _matrix(self, channels: Channels, axes: Sequence[str]) -> "Table":
        heads = [f"{printable(name)} [{shown_unit(unit).symbol}]" for name, unit in channels]
        table = make_table("axis", *heads, right=tuple(range(1, 1 + len(heads))))
        for axis in axes:
            values = (self._latest.get(f"{axis}.{name}") for name, _ in channels)
            texts = (
                shown_unit(unit).text(value)
                for value, (_, unit) in zip(values, channels, strict=True)
            )
            table.add_row(printable(axis), *texts)
        return table

    def _column(self, channels: Channels, limits: Mapping[str, Sequence[float | None]]) -> "Table":
        heads = ("value", "", "", "lowest", "", "highest")
        table = make_table(*heads, *(["limits"] if limits else []), right=(1, 3, 5))
        for name, symbol in channels:
            shown = shown_unit(symbol)
            value = self._latest.get(name)
            low, high = self._ranges.get(name, (math.nan, math.nan))
            row = [
                printable(name),
                shown.text(value),
                shown.symbol,
                shown.text(low),
                bar(value, low, high) if shown.text(low) != shown.text(high) else "",
                shown.text(high),
            ]
            least, most = limits.get(name, (None, None))
            style = "red" if value is not None and _is_beyond(value, least, most) else ""
            limit = _limit_text(least, most, symbol)
            table.add_row(*row, *([limit] if limits else []), style=style)
        return table


def _is_beyond(value: float, least: float | None, most: float | None) -> bool:
    return (least is not None and value < least) or (most is not None and value > most)


def _limit_text(least: float | None, most: float | None, symbol: str) -> str:
    shown = shown_unit(symbol)
    if least is None and most is None:
        return ""
    if least is None or most is None:
        word, limit = ("up to", most) if least is None else ("from", least)
        return f"{word} {shown.short(limit or 0.0)}"
    return shown.range_text(least, most)


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
