"""The view of `hil-bench watch`: tables made of the messages of the feed."""

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hil_bench.cli.live_words import (
    ecu_text,
    fault_text,
    health_text,
    node_text,
)
from hil_bench.cli.watch_values import Values, make_table
from hil_bench.errors import printable

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table

ONCE = 2.0
"""The time that a bus is listened to for one picture [s]; most heartbeats come once a second."""

REFRESH = 0.1
"""Time between two pictures [s]."""

_ITEMS = 12  # of work, most
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
        self._values = Values([(name, unit) for name, unit in hello["channels"]])
        self._state: Mapping[str, Any] = {"nodes": {}, "faults": []}
        self._health: Mapping[str, Any] = {}
        self._lost = 0

    def take(self, message: Mapping[str, Any]) -> None:
        """Take a message."""
        self.is_moving = True
        match message["type"]:
            case "rows":
                self._values.take(message["rows"][-1])
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

        work = self._state.get("work")
        parts: list[RenderableType] = [self._heading()]
        if work:
            parts += work_parts(work, self._hello.get("work", {}).get("verb", "work"))
        parts += self._values.tables(
            list(self._hello["axes"]), limits_of(work or {}, self._values.time)
        )
        if self._is_bench:
            parts += [self._node_table(), self._fault_part()]
            parts.append(f"loop   {health_text(self._health)}")
        parts += [f"event  {event}" for event in self._events]
        if self._lost:
            parts.append(f"{self._lost} messages lost: this terminal is too slow")
        return Group(*parts)

    def _heading(self) -> "RenderableType":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        time = self._values.time
        name, pid = printable(str(self._hello["name"])), self._hello["pid"]
        text = Text(f"bench  {name}, process {pid}, at {time:.3f} s")
        if not self.is_there:
            text.append("   has ended; waiting for it", style="bold red")
        elif not self.is_moving:
            text.append("   its time stands still", style="bold yellow")
        return text

    @property
    def _is_bench(self) -> bool:
        return bool(self._hello.get("work", {"is_bench": True}).get("is_bench"))

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


def limits_of(work: Mapping[str, Any], now: float) -> dict[str, tuple[float | None, float | None]]:
    """Return the lowest and highest right value of channels at a time [s], in SI.

    Those of the work, and of requirements that want them at that time without a condition.
    """
    limits: dict[str, tuple[float | None, float | None]] = {
        name: (low, high) for name, (low, high) in work.get("limits", {}).items()
    }
    for margin in work.get("margins", ()):
        for band in margin["bands"]:
            if not band["is_strict"] or not band["begin"] <= now <= (band["end"] or now):
                continue
            low, high = limits.get(band["channel"], (None, None))
            lows = [each for each in (low, band["low"]) if each is not None]
            highs = [each for each in (high, band["high"]) if each is not None]
            limits[band["channel"]] = max(lows, default=None), min(highs, default=None)
    return limits


def work_parts(work: Mapping[str, Any], verb: str) -> "list[RenderableType]":
    """Return the progress of work, with the margins of its requirements and its findings."""
    from rich.text import Text  # noqa: PLC0415 - it is an extra

    unit = f" {work.get('unit', '')}".rstrip()
    progress = f"{work['done']:g} of {work['total']:g}{unit}  " if work["total"] else ""
    left = work.get("left")
    remaining = "" if left is None else f", {left:.0f} s left"
    words = work["now"] or work["verdict"]
    parts: list[RenderableType] = [printable(f"{verb}  {progress}{words}{remaining}")]
    if work["detail"]:
        parts.append(printable(f"limits  {work['detail']}"))
    counts = "  ".join(f"{count} {name}" for name, count in work["counts"].items())
    if counts:
        parts.append(printable(f"so far  {counts}"))
    if work.get("margins"):
        table = make_table("requirement", "so far", "margin")
        for each in work["margins"]:
            is_bad = each["margin"] is not None and each["margin"] < 0.0
            style = "red" if is_bad or each["verdict"] == "failed" else ""
            words = each["verdict"] or ("open" if each["margin"] is None else "holds")
            table.add_row(*map(printable, (each["id"], words, each["text"])), style=style)
        parts.append(table)
    shown = [each for each in work["items"] if each["verdict"] not in {"", "done"}][:_ITEMS]
    for each in shown:
        style = "red" if each["verdict"] in {"failed", "stopped", "crashed"} else ""
        line = printable(f"  {each['name']} {each['verdict']} {each['text']}".rstrip())
        parts.append(Text(line, style=style))
    return parts
