"""The page for work that is no running bench: `commission`, `shadow`, `test`, `campaign`."""

import argparse
import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import hil_bench
from hil_bench.cli.feed_side import check_panel_argument, panel_of, take_place
from hil_bench.errors import ConfigError
from hil_bench.outside.feed.places import HAS_SOCKETS
from hil_bench.outside.feed.process import CAPACITY, MOST_COMMANDS, FeedProcess
from hil_bench.outside.feed.server import FeedPlan
from hil_bench.outside.processes.shared_ring import SharedRing
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.recording.inline_recorder import RecordingSink
from hil_bench.session.session import Session
from hil_bench.session.work_feed import WorkFeed, WorkState

if TYPE_CHECKING:
    from hil_bench.outside.recording.channels import Channel


_PATIENCE = 15.0  # with a panel that starts [s]; the work begins with it


class WorkView:
    """The view of work for people; nobody looks without --panel or --name.

    Args:
        feed: where it is shown; None for nowhere.
    """

    def __init__(self, feed: WorkFeed | None = None) -> None:
        self._feed = feed
        self.state = WorkState()

    @property
    def is_watched(self) -> bool:
        """True if anybody may look."""
        return self._feed is not None

    def show(self, **changes: object) -> None:
        """Change what is shown, see `WorkState`."""
        self.state = self.state._replace(**changes)  # type: ignore[arg-type]
        if self._feed is not None:
            self._feed.show(self.state)

    def put_row(self, values: Sequence[float]) -> None:
        """Show a row: time [s], then a value a channel in its SI unit."""
        if self._feed is not None:
            self._feed.put_row(values)


class ShownRows:
    """A recording whose rows people see, too.

    Args:
        recording: takes everything; None for nobody.
        view: where the rows are shown.
    """

    def __init__(self, recording: RecordingSink | None, view: WorkView) -> None:
        self._recording = recording
        self._view = view

    def append_row(self, values: Sequence[float]) -> None:
        """Take a row: time [s], then a value a channel in its SI unit."""
        if self._recording is not None:
            self._recording.append_row(values)
        self._view.put_row(values)


def hold_to_real_time(session: Session) -> None:
    """Let the time of a virtual bench pass no faster than a clock, for people who watch."""
    clock = MonotonicClock()
    start = clock.now() - session.now
    session.watch(ticks=lambda now: clock.sleep_until(start + now))


def add_work_arguments(parser: argparse.ArgumentParser, verb: str) -> None:
    """Add what concerns those who watch the work.

    Args:
        parser: of the verb.
        verb: its name, by which others find it.
    """
    group = parser.add_argument_group("watching")
    group.add_argument(
        "--panel",
        action="store_true",
        help="serve the web page of hil-bench panel while the verb runs",
    )
    group.add_argument(
        "--name",
        metavar="NAME",
        help="name for hil-bench panel, watch and ctl (default with --panel: "
        f"{verb}; without both, nobody can watch)",
    )


@contextlib.contextmanager
def watched_work(
    args: argparse.Namespace,
    verb: str,
    title: str,
    channels: "Sequence[Channel]" = (),
    again: Sequence[str] = (),
) -> Iterator[WorkView]:
    """Let people watch work in the block; their stop is a Ctrl-C.

    Args:
        args: the command line, with what `add_work_arguments` adds.
        verb: what is being done.
        title: what with, in words.
        channels: of its rows, after the time.
        again: words of the command that repeats a run of it, before ``--run=KEY``; empty where
            nothing does.

    Yields:
        Takes what is to be seen.

    Raises:
        ConfigError: this machine has no feeds.
    """
    if not (args.panel or args.name):
        yield WorkView()
        return
    if args.panel:
        check_panel_argument()
    if not HAS_SOCKETS:
        raise ConfigError("--name, --panel: this machine has no Unix sockets to be watched by")
    place = take_place(args.name, verb)
    if place is None:
        yield WorkView()
        return
    hello = {
        "name": place.name,
        "pid": os.getpid(),
        "program": f"hil-bench {hil_bench.__version__}",
        "bench": f"{verb} {title}",
        "bench_file": None,
        "channels": [list(channel) for channel in channels],
        **{name: {} for name in ("devices", "machines", "axes", "fault_targets")},
        "nodes": [],
        "work": {"verb": verb, "title": title, "again": list(again)},
    }
    plan = FeedPlan(hello, 1 + len(channels), SharedRing(CAPACITY), SharedRing(MOST_COMMANDS))
    with contextlib.ExitStack() as stack:
        if args.panel:
            stack.enter_context(panel_of(place.name))
        stack.callback(place.release)
        feed = WorkFeed(FeedProcess(place.listener, plan), plan, _interrupt_main())
        stack.enter_context(feed)
        if args.panel:
            feed.wait_for_client(_PATIENCE)
        yield WorkView(feed)


def _interrupt_main() -> Callable[[], None]:
    """Return a callable that interrupts the working thread like a Ctrl-C, wherever it waits."""
    main = threading.get_ident()
    return lambda: signal.pthread_kill(main, signal.SIGINT)
