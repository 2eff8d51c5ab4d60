"""The feed of a verb: of runs of a bench, and of other work."""

import argparse
import contextlib
import importlib.util
import itertools
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import hil_bench
from hil_bench.abilities.live.feed.places import HAS_SOCKETS, Place
from hil_bench.abilities.live.feed.process import CAPACITY, MOST_COMMANDS, FeedProcess
from hil_bench.abilities.live.feed.server import FeedPlan
from hil_bench.abilities.live.session_feed import Feed, Health, feed_parts
from hil_bench.abilities.live.work_feed import WorkFeed, WorkState
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.bench import Shown
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.peers import peers_of
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.processes.shared_ring import SharedRing
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.session.session import Session

if TYPE_CHECKING:
    from hil_bench.outside.recording.channels import Channel


# The feed of `hil-bench run`: its arguments, its name, and what it says of the bench.

logger = logging.getLogger(__name__)

_NAME = "bench"
_MOST_NAMES = 100
_FAREWELL = 3.0  # for a panel to end [s]


def add_feed_arguments(
    parser: argparse.ArgumentParser, often: "argparse._ActionsContainer"
) -> None:
    """Add what concerns those who watch the bench, --panel to the group `often`."""
    group = parser.add_argument_group("watching")
    group.add_argument(
        "--name",
        metavar="NAME",
        help="name by which hil-bench watch, hil-bench ctl and hil_bench.attach() find this bench "
        f"(default {_NAME}, {_NAME}-2, ...)",
    )
    group.add_argument(
        "--no-feed", action="store_true", help="let nobody watch this bench or give it commands"
    )
    often.add_argument(
        "--panel",
        action="store_true",
        help="serve the web page of hil-bench panel, too, in a process of its own",
    )


class ShownWork(NamedTuple):
    """The work that plays on a bench, for those who watch.

    Attributes:
        verb: in a word.
        title: in words.
        state: returns how it goes; called ten times a second.
    """

    verb: str
    title: str
    state: Callable[[], WorkState]


@contextlib.contextmanager
def open_feed(
    args: argparse.Namespace,
    config: BenchConfig,
    session: Session,
    *,
    statistics: TickStatistics | None = None,
    health: Health = dict,
    work: ShownWork | None = None,
) -> Iterator[Feed | None]:
    """Let people watch a session in the block.

    Args:
        args: the command line.
        config: of the bench.
        session: to be watched.
        statistics: of the loop, shared.
        health: see `Feed`.
        work: what is played on it; None where nothing is.

    Yields:
        The feed; None where there is none.
    """
    place = None if args.no_feed or not HAS_SOCKETS else take_place(args.name, _NAME)
    if place is None:
        yield None
        return
    hello = hello_of(place.name, config, session)
    if work is not None:
        hello["work"] = {"verb": work.verb, "title": work.title, "is_bench": True}
    plan = FeedPlan(
        hello,
        1 + len(session.channels),
        SharedRing(CAPACITY),
        SharedRing(MOST_COMMANDS),
        statistics,
    )

    feed = Feed(
        session,
        FeedProcess(place.listener, plan),
        plan,
        health=health,
        parts=feed_parts(session, config, is_real_time=statistics is not None),
        work=work and work.state,
    )
    with contextlib.ExitStack() as stack:
        if args.panel:
            stack.enter_context(panel_of(place.name))
        stack.callback(place.release)
        stack.callback(feed.stop)
        yield feed


def check_feed_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if not args.panel:
        return
    if args.no_feed or not HAS_SOCKETS:
        why = "--no-feed" if args.no_feed else "this machine has no Unix sockets"
        raise ConfigError(f"--panel: needs the feed, which is off ({why}); leave one out")
    check_panel_argument()


def check_panel_argument() -> None:
    """Refuse --panel where it cannot be.

    Raises:
        ConfigError: its libraries are missing.
    """
    if importlib.util.find_spec("uvicorn") is None or importlib.util.find_spec("starlette") is None:
        raise ConfigError("--panel needs an extra; pip install 'hil-bench[panel]'")


def hello_of(name: str, config: BenchConfig, session: Session) -> dict[str, Any]:
    """Return the greeting of a bench for those who come to watch it."""
    return {
        "name": name,
        "pid": os.getpid(),
        "program": f"hil-bench {hil_bench.__version__}",
        "bench": str(config.path or "built-in bench"),
        "tick_s": config.tick_ns * 1e-9,
        "channels": [list(channel) for channel in session.channels],
        "nodes": list(session.nodes),
        "bench_file": str(Path(config.path).resolve()) if config.path else None,
        "seed": config.seed,
        "devices": dict(_devices(config)),
        "ecus": dict(_ecus(config, session)),
        **{
            name: value
            for each in session.bench.extensions
            if isinstance(each, Shown)
            for name, value in each.greeting().items()
        },
        "machines": dict(_machines(config)),
        "axes": {
            axis.name: [influence._asdict() for influence in axis.influences]
            for axis in session.bench.axes
        },
    }


def _devices(config: BenchConfig) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each node, and what it is."""
    buses = number_buses(config)
    for node in config.nodes:
        page = node.kind.page(node)
        yield (
            node.name,
            {
                "node_id": node.node_id,
                "bus": buses[node.name],
                "kind": node.kind.name,
                "axis": node.axis,
                "eds": str(node.eds.resolve()),
                "measures": node.kind.measured(node),
                "page": page and page._asdict(),
            },
        )


def _ecus(config: BenchConfig, session: Session) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each J1939 device, and what it is."""
    buses = number_buses(config)
    for ecu in config.ecus:
        yield (
            ecu.name,
            {
                "address": ecu.address,
                "bus": buses[ecu.name],
                "kind": ecu.kind.name,
                "axis": ecu.kind.axis_of(ecu),
                "signals": {
                    name: {"unit": value.unit, "is_settable": value.takes is not None}
                    for name, value in peers_of(session.bench)[ecu.name].values.items()
                },
                "groups": [
                    {"pgn": each.group, "is_sent": each.is_sent, "signals": each.signals}
                    for each in ecu.kind.messages(ecu)
                ],
            },
        )


def _machines(config: BenchConfig) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each axis, and what the page needs to draw it."""
    supplies = {axis: supply.name for supply in config.supplies for axis in supply.axes}
    for axis in config.axes:
        content: dict[str, Any] = {"kind": axis.kind.name, "supply": supplies.get(axis.name, "")}
        page = axis.kind.page(axis)
        if page is not None:
            content |= {"svg": page.svg, "plots": page.plots}
            content["circuit"] = page.circuit and page.circuit._asdict()
        yield axis.name, content


@contextlib.contextmanager
def panel_of(name: str) -> Iterator[None]:
    """Serve the page of a bench, which must end before the block does.

    It is in a session of its own: Ctrl-C is for the bench alone.

    Yields:
        Nothing.
    """
    command = [sys.executable, "-m", "hil_bench", "panel", "--bench", name, "--once"]
    panel = subprocess.Popen(  # noqa: S603 - this program, with a name that has been checked
        command, stdin=subprocess.DEVNULL, start_new_session=True
    )
    try:
        yield
    finally:
        _end(panel)


def _end(panel: "subprocess.Popen[bytes]") -> None:
    """Let a panel end, which has seen the end of its bench; or end it."""
    try:
        panel.wait(_FAREWELL)
    except subprocess.TimeoutExpired:
        panel.terminate()
        try:
            panel.wait(_FAREWELL)
        except subprocess.TimeoutExpired:
            panel.kill()
            panel.wait()


def take_place(name: str | None, usual: str) -> Place | None:
    """Return a place of this name, or of the first of the usual ones that is free.

    Args:
        name: as given; None for the usual one: ``bench``, ``bench-2``, ...
        usual: what these begin with.

    Returns:
        None where there is none, which it warns of.
    """
    try:
        if name is not None:
            return Place(name)
        for number in itertools.islice(itertools.count(1), _MOST_NAMES):
            with contextlib.suppress(ConfigError):
                return Place(usual if number == 1 else f"{usual}-{number}")
    except BusError as error:
        logger.warning("feed: %s; the run goes on, and nobody can watch it", error)
    return None


# The page for work that is no running bench: `commission`, `shadow`, `test`, `campaign`.

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


class TakesRows(Protocol):
    """Takes rows, as a recording."""

    def append_row(self, values: Sequence[float]) -> None:
        """Take a row: time [s], then a value a channel in its SI unit."""


class ShownRows:
    """A recording whose rows people see, too.

    Args:
        recording: takes everything; None for nobody.
        view: where the rows are shown.
    """

    def __init__(self, recording: TakesRows | None, view: WorkView) -> None:
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
        **{name: {} for name in ("devices", "machines", "axes")},
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
