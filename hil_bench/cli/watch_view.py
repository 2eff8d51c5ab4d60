"""The view of `hil-bench watch`: tables made of the messages of the feed."""

import math
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hil_bench.cli.live_words import (
    ecu_text,
    fault_text,
    health_text,
    node_text,
    shown_in,
    value_text,
)
from hil_bench.errors import printable

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table

ONCE = 2.0
"""The time that a bus is listened to for one picture [s]; most heartbeats come once a second."""

REFRESH = 0.1
"""Time between two pictures [s]."""

_BAR = 20
_BLOCKS = " ▏▎▍▌▋▊▉█"
_EVENTS = 5
STATE_STYLES = {"OPERATIONAL": "green", "PRE-OPERATIONAL": "yellow", "STOPPED": "red"}
"""Colours of NMT states."""


class WatchView:
    """The state of a bench as its messages say.

    Args:
        hello: what the bench says of itself.

    Attributes:
        is_there: whether the bench runs.
        is_moving: whether it has said something lately.
    """

    def __init__(self, hello: Mapping[str, Any]) -> None:
        self._events: deque[str] = deque(maxlen=_EVENTS)
        self.begin(hello)

    def begin(self, hello: Mapping[str, Any]) -> None:
        """Show a bench from its start."""
        self.is_there = self.is_moving = True
        self._hello = hello
        self._values: dict[str, float | None] = {}
        self._ranges: dict[str, tuple[float, float]] = {}
        self._state: Mapping[str, Any] = {"nodes": {}, "faults": []}
        self._health: Mapping[str, Any] = {}
        self._lost = 0

    def take(self, message: Mapping[str, Any]) -> None:
        """Take a message."""
        self.is_moving = True
        match message["type"]:
            case "rows":
                self._take_row(message["rows"][-1])
            case "state":
                self._state = message
            case "health":
                self._health = message
            case "event":
                verb = "begins" if message["begins"] else "ends"
                text = f"{message['time']:.3f} s: {message['kind']} {message['target']} {verb}"
                self._events.append(printable(text))
            case "lost":
                self._lost += message["rows"] + message["others"]
            case _:
                pass

    def render(self) -> "Group":
        """Return the view to draw."""
        from rich.console import Group  # noqa: PLC0415 - it is an extra

        parts: list[RenderableType] = [self._heading(), self._value_table(), self._node_table()]
        parts.append(self._fault_part())
        parts.append(f"loop   {health_text(self._health)}")
        parts += [f"event  {event}" for event in self._events]
        if self._lost:
            parts.append(f"{self._lost} messages lost: this terminal is too slow")
        return Group(*parts)

    def _take_row(self, row: list[float | None]) -> None:
        names = ["time", *(name for name, _ in self._hello["channels"])]
        self._values = dict(zip(names, row, strict=True))
        for name, value in self._values.items():
            if value is not None:
                low, high = self._ranges.get(name, (value, value))
                self._ranges[name] = (min(low, value), max(high, value))

    def _heading(self) -> "RenderableType":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        time = self._values.get("time") or 0.0
        name, pid = printable(str(self._hello["name"])), self._hello["pid"]
        text = Text(f"bench  {name}, process {pid}, at {time:.3f} s")
        if not self.is_there:
            text.append("   has ended; waiting for it", style="bold red")
        elif not self.is_moving:
            text.append("   its time stands still", style="bold yellow")
        return text

    def _value_table(self) -> "Table":
        table = make_table("value", "", "", "lowest", "", "highest", right=(1, 3, 5))
        for name, symbol in self._hello["channels"]:
            unit = shown_in(symbol)
            value = self._values.get(name)
            low, high = self._ranges.get(name, (math.nan, math.nan))
            table.add_row(
                printable(name),
                value_text(value, unit),
                unit.symbol,
                value_text(low, unit),
                bar(value, low, high),
                value_text(high, unit),
            )
        return table

    def _node_table(self) -> "Table":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        table = make_table("node", "state")
        for name, node in self._state["nodes"].items():
            style = "red" if node["errors"] else STATE_STYLES.get(node["state"], "")
            table.add_row(printable(name), Text(node_text(node), style=style))
        for name, ecu in self._state.get("ecus", {}).items():
            table.add_row(printable(name), Text(ecu_text(ecu), style="red" if ecu["codes"] else ""))
        return table

    def _fault_part(self) -> "RenderableType":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        faults = self._state["faults"]
        lines = [f"fault  {fault['number']}  {fault_text(fault)}" for fault in faults]
        return Text("\n".join(lines), style="bold red") if lines else Text("fault  none")


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
