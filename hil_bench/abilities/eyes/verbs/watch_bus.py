"""`hil-bench watch` on a bus: what passes there as a picture; nothing is sent."""

import argparse
import math
from collections.abc import Callable, Iterator
from time import monotonic
from typing import TYPE_CHECKING

from hil_bench.abilities.common.arguments import seen_from_bus
from hil_bench.abilities.common.terminal import (
    ONCE,
    REFRESH,
    STATE_STYLES,
    bar,
    make_table,
)
from hil_bench.abilities.eyes.bus_state import EXTENDED, BusState, HeldValue, Stream
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.listener import Listener, loss_words
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.abilities.eyes.verbs.eyes_arguments import known_ecus, known_nodes
from hil_bench.abilities.eyes.verbs.listening import open_listener
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.exit_codes import ExitCode, interruption
from hil_bench.errors import printable
from hil_bench.outside.bits import USUAL_BITRATE, bitrate_text

if TYPE_CHECKING:
    from rich.console import Console, Group, RenderableType
    from rich.table import Table
    from rich.text import Text


# The bus view of `hil-bench watch`: tables of nodes, values, events and identifiers.

_BAR = 8
SILENCE = 1.0
"""Time without a frame after which the picture says so [s]."""


class BusView:
    """Draws a bus.

    Args:
        bitrate: that its load refers to [bit/s].
        listener: hears it.
        state: what was heard.
    """

    def __init__(self, bitrate: int, listener: Listener, state: BusState) -> None:
        self._bitrate = bitrate
        self._listener = listener
        self._state = state

    def render(self) -> "Group":
        """Return the view to draw."""
        from rich.console import Group  # noqa: PLC0415 - it is an extra

        parts: list[RenderableType] = [self._heading()]
        if self._state.nodes:
            parts.append(self._node_table())
        parts += [f"event  {_event_text(sight)}" for sight in self._state.events]
        if self._state.values:
            parts.append(self._value_table())
        if self._state.streams:
            parts.append(self._stream_table())
        return Group(*parts)

    def _heading(self) -> "Text":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        state = self._state
        load = f"load {state.load * 100.0:.1f} % of {bitrate_text(self._bitrate)}"
        facts = [f"{state.frames} frames", load, *loss_words(self._listener.losses)]
        text = Text(f"bus    {printable(self._listener.description)}, {', '.join(facts)}")
        if state.silence > SILENCE or not state.frames:
            so_far = "no frame for" if state.frames else "no frame yet, after"
            text.append(f"   {so_far} {state.silence:.1f} s", style="bold yellow")
        return text

    def _node_table(self) -> "Table":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        table = make_table("node", "ID", "state", "heartbeat", "EMCY", right=(1,))
        for node in self._state.nodes:
            number = node.node_id
            errors = self._state.errors.get(number, {}).items()
            table.add_row(
                printable(node.name),
                str(number),
                self._node_state(node),
                self._heartbeat(number),
                Text("; ".join(f"0x{code:04X} {text}" for code, text in errors), style="red"),
            )
        return table

    def _node_state(self, node: KnownNode) -> "Text":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        if not self._state.has_heard(node.node_id):
            return Text("not heard", style="dim")
        name = "not known" if node.state is None else node.state.name.replace("_", "-")
        commanded = "" if node.state is None or self._state.has_reported(node) else ", commanded"
        return Text(f"{name}{commanded}", style=STATE_STYLES.get(name, ""))

    def _heartbeat(self, node_id: int) -> "Text":
        from rich.text import Text  # noqa: PLC0415 - it is an extra

        period = self._state.heartbeat_of(node_id)
        missing = self._state.heartbeat_missing(node_id)
        text = Text("" if math.isnan(period) else f"every {period * 1e3:.0f} ms")
        if missing:
            text.append(f", none for {missing:.1f} s", style="bold red")
        return text

    def _value_table(self) -> "Table":
        table = make_table("node", "PDO", "value", "", "lowest", "", "highest", right=(4, 6))
        for can_id, values in sorted(self._state.values.items()):
            stream = self._state.streams[can_id]
            for held in values.values():
                table.add_row(self._node_name(stream), stream.name, *_value_cells(held))
        return table

    def _stream_table(self) -> "Table":
        table = make_table(
            "id", "node", "frame", "bytes", "count", "every", "last", "", right=(3, 4, 5, 6)
        )
        for can_id, stream in sorted(self._state.streams.items()):
            period = stream.period
            table.add_row(
                "29-bit" if can_id == EXTENDED else f"{stream.frame.can_id:03X}",
                self._node_name(stream),
                "not CANopen" if can_id == EXTENDED else stream.name,
                str(len(stream.frame.data)),
                str(stream.count),
                "-" if math.isnan(period) else f"{period * 1e3:.1f} ms",
                f"{self._state.age_of(stream):.1f} s ago",
                f"! {printable(stream.problem)}" if stream.problem else "",
            )
        return table

    def _node_name(self, stream: Stream) -> str:
        node = self._state.decoder.nodes.get((0, stream.node_id or 0))
        return printable(stream.node or (node.name if node is not None else ""))


def _value_cells(held: HeldValue) -> Iterator[str]:
    """Yield the name of an object, its value, and its range where it is a measure."""
    reading = held.reading
    yield printable(reading.name or reading.place)
    yield printable(reading.text)
    value = reading.value
    if isinstance(value, str) or math.isnan(held.low) or reading.text.startswith("0x"):
        return
    yield f"{held.low:.6g}"
    yield bar(value, held.low, held.high, _BAR)
    yield f"{held.high:.6g}"


def _event_text(sight: Sight) -> str:
    said = f"{sight.name} {sight.text}".rstrip()
    return printable(f"{sight.now * 1e-9:.3f} s: {sight.node or 'all nodes'}: {said}")


def watch_bus(args: argparse.Namespace, console: "Console") -> int:
    """Show a bus until Ctrl-C, or once."""
    from rich.live import Live  # noqa: PLC0415 - it is an extra

    config = seen_from_bus(args, load_bench_config(args))
    bitrate = config.bus.bitrate or USUAL_BITRATE
    decoder = Decoder(known_nodes(args, config), known_ecus(args, config))
    state = BusState(decoder, bitrate, config.bus.speedup)
    with open_listener(config.bus) as listener, interruption() as interrupted:
        view = BusView(bitrate, listener, state)
        moments = hear(listener, state, monotonic)
        if args.once:
            for passed in moments:
                if passed >= ONCE or interrupted.requested:
                    break
            if not args.quiet:
                console.print(view.render())
        else:
            with Live(console=console, screen=True, auto_refresh=False) as live:
                for _ in moments:
                    if interrupted.requested:
                        break
                    live.update(view.render(), refresh=True)
    return ExitCode.DONE if state.frames else ExitCode.INCONCLUSIVE


def hear(listener: Listener, state: BusState, clock: Callable[[], float]) -> Iterator[float]:
    """Hear a bus until it is lost, which is a `BusError`.

    Args:
        listener: hears the bus.
        state: takes the frames.
        clock: the time [s].

    Yields:
        Time since the start [s], whenever a picture is due.
    """
    begin = heard = clock()
    due = begin + REFRESH
    while True:
        logged = listener.hear(max(due - clock(), 0.0))
        now = clock()
        if logged is not None:
            state.take(logged)
            heard = now
        if now >= due:
            state.wait(round((now - heard) * 1e9))
            yield now - begin
            due = clock() + REFRESH
