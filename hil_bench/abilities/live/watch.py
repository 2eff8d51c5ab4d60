"""`hil-bench watch`: a running bench, or any bus, in the terminal."""

import argparse
import contextlib
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.common import terminal
from hil_bench.abilities.common.shown_units import add_units_argument, shown_unit
from hil_bench.abilities.live.client import FeedClient, connect
from hil_bench.abilities.live.ctl import (
    add_bench_argument,
    bench_errors,
    has_bench,
    progress_text,
)
from hil_bench.ability import given_to
from hil_bench.cli import results
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.parser import add_options, take_over
from hil_bench.errors import BusError, printable

if TYPE_CHECKING:
    from rich.console import Console, Group, RenderableType
    from rich.table import Table


# The values of a bench as tables for a terminal: one axis in a column, several side by side.

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
        table = terminal.make_table("axis", *heads, right=tuple(range(1, 1 + len(heads))))
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
        table = terminal.make_table(*heads, *(["limits"] if limits else []), right=(1, 3, 5))
        for name, symbol in channels:
            shown = shown_unit(symbol)
            value = self._latest.get(name)
            low, high = self._ranges.get(name, (math.nan, math.nan))
            row = [
                printable(name),
                shown.text(value),
                shown.symbol,
                shown.text(low),
                terminal.bar(value, low, high) if shown.text(low) != shown.text(high) else "",
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


# The view of `hil-bench watch`: tables made of the messages of the feed.

_ITEMS = 12  # of work, most
_EVENTS = 5


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
        self._state: Mapping[str, Any] = {"nodes": {}}
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
        if has_bench(self._hello):
            parts += [self._node_table(), *self._added_parts()]
            parts.append(f"loop   {terminal.health_text(self._health)}")
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

    def _node_table(self) -> "Table":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        table = terminal.make_table("node", "state")
        for name, node in self._state["nodes"].items():
            style = "red" if node["errors"] else terminal.STATE_STYLES.get(node["state"], "")
            table.add_row(printable(name), Text(terminal.node_text(node), style=style))
        for name, ecu in self._state.get("ecus", {}).items():
            table.add_row(
                printable(name), Text(results.ecu_text(ecu), style="red" if ecu["codes"] else "")
            )
        return table

    def _added_parts(self) -> "Iterator[RenderableType]":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        for module in given_to("ctl"):
            if not module.NOTHING:
                continue
            lines = module.state_lines(self._state)
            yield Text("\n".join(lines), style="bold red") if lines else Text(module.NOTHING)


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

    left = work.get("left")
    remaining = "" if left is None else f", {left:.0f} s left"
    words = work["now"] or work["verdict"]
    parts: list[RenderableType] = [printable(f"{verb}  {progress_text(work)}{words}{remaining}")]
    if work["detail"]:
        parts.append(printable(f"limits  {work['detail']}"))
    counts = "  ".join(f"{count} {name}" for name, count in work["counts"].items())
    if counts:
        parts.append(printable(f"so far  {counts}"))
    if work.get("margins"):
        table = terminal.make_table("requirement", "so far", "margin")
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


_RETRY = 0.5
_EXAMPLES = """\
examples:
  hil-bench watch
  hil-bench watch --bench bench-2
  hil-bench watch --once                        one picture, for a file or a small terminal
  hil-bench watch -i socketcan -c can0          any bus; nothing is sent
  hil-bench watch -i socketcan -c can0 bench.toml
  hil-bench watch -i socketcan -c can0 --eds 5=vendor.eds --once
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "watch",
        description="Show values, nodes, faults and timing of a bench that hil-bench run runs\n"
        "on this machine, until Ctrl-C. When the bench ends, it waits for the next. With -i, -c,\n"
        "--eds or a bench.toml, show a bus instead: nodes, values of PDOs, EMCY, load, rates.",
        epilog=_EXAMPLES,
    )
    add_bench_argument(parser)
    parser.add_argument(
        "--once",
        action="store_true",
        help=f"show one picture, and exit; listen to a bus for {terminal.ONCE:g} s",
    )
    add_units_argument(parser)
    add_options("watch", parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Show the bench or the bus; `ConfigError` where rich is missing."""
    code = take_over("watch", args)
    if code is not None:
        return code
    console = terminal.make_console(once=args.once)
    with bench_errors(), connect(args.bench) as client:
        if args.once:
            shown = picture(client)
            if not args.quiet:
                console.print(shown)
            return ExitCode.DONE
        follow(client, console, lambda: connect(client.name))
    return ExitCode.DONE


def picture(client: FeedClient) -> Any:  # noqa: ANN401 - a renderable of rich
    """Return the bench as it is now."""
    view = WatchView(client.hello)
    status = client.request("status")
    view.take({"type": "state", **status["state"]})
    view.take({"type": "health", **status["health"]})
    if status["values"] is not None:
        view.take({"type": "rows", "rows": [list(status["values"].values())]})
    return view.render()


def follow(client: FeedClient, console: "Console", reconnect: Callable[[], FeedClient]) -> None:
    """Show a bench until Ctrl-C, and wait for it where it has ended."""
    from rich.live import Live  # noqa: PLC0415 - it is an extra

    view = WatchView(client.hello)
    with Live(console=console, screen=True, auto_refresh=False) as live:
        for _ in views(client, view, reconnect):
            live.update(view.render(), refresh=True)


def views(
    client: FeedClient,
    view: WatchView,
    reconnect: Callable[[], FeedClient],
    wait: Callable[[float], None] | None = None,
) -> Iterator[None]:
    """Feed a view, and yield whenever it is to be drawn; it ends only with an exception.

    Args:
        client: connected.
        view: takes the messages.
        reconnect: connects again.
        wait: waits some seconds before that; None for the usual way.
    """
    from time import sleep  # noqa: PLC0415 - only for a bench that is gone

    while True:
        with contextlib.suppress(BusError), client:
            yield from _messages(client, view)
        view.is_there = False
        while not view.is_there:
            yield
            (wait or sleep)(_RETRY)
            with contextlib.suppress(BusError):
                client = reconnect()
                view.begin(client.hello)


def _messages(client: FeedClient, view: WatchView) -> Iterator[None]:
    client.request("watch", rows_every_s=terminal.REFRESH)
    while True:
        message = client.receive(1.0)
        if message is None:
            view.is_moving = False
            yield
        else:
            view.take(message)
            if message["type"] in {"rows", "state", "lost"}:
                yield
