"""`hil-bench watch` on a bus: what passes there as a picture; nothing is sent."""

import argparse
from collections.abc import Callable, Iterator
from time import monotonic
from typing import TYPE_CHECKING

from hil_bench.abilities.eyes.bus_state import BusState
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.verbs.bus_view import BusView
from hil_bench.abilities.eyes.verbs.eyes_arguments import known_ecus, known_nodes
from hil_bench.abilities.eyes.verbs.listening import open_listener
from hil_bench.cli.arguments import load_bench_config, seen_from_bus
from hil_bench.cli.exit_codes import ExitCode, interruption
from hil_bench.cli.terminal import ONCE, REFRESH
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.transports.listener import Listener

if TYPE_CHECKING:
    from rich.console import Console


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
