"""`hil-bench watch`: a running bench, or any bus, in the terminal."""

import argparse
import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from hil_bench.cli.ctl import add_bench_argument, bench_errors
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.options import add_options, take_over
from hil_bench.cli.units_argument import add_units_argument
from hil_bench.cli.watch_view import ONCE, REFRESH, WatchView
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.feed.client import FeedClient, connect

if TYPE_CHECKING:
    from rich.console import Console

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
        help=f"show one picture, and exit; listen to a bus for {ONCE:g} s",
    )
    add_units_argument(parser)
    add_options("watch", parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Show the bench or the bus; `ConfigError` where rich is missing."""
    code = take_over("watch", args)
    if code is not None:
        return code
    console = make_console()
    with bench_errors(), connect(args.bench) as client:
        if args.once:
            shown = picture(client)
            if not args.quiet:
                console.print(shown)
            return ExitCode.DONE
        follow(client, console, lambda: connect(client.name))
    return ExitCode.DONE


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
    client.request("watch", rows_every_s=REFRESH)
    while True:
        message = client.receive(1.0)
        if message is None:
            view.is_moving = False
            yield
        else:
            view.take(message)
            if message["type"] in {"rows", "state", "lost"}:
                yield
