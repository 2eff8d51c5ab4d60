"""The feed of a verb: of runs of a bench, and of other work."""

import argparse
import contextlib
import itertools
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import hil_bench
from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.common.work import ShownWork, WorkState, WorkView
from hil_bench.abilities.live import messages
from hil_bench.abilities.live.places import HAS_SOCKETS, NAME, Place, check_panel_argument
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedProcess
from hil_bench.abilities.live.session_feed import Feed, Shown, feed_parts
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.commands import Journal
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session
from hil_bench.cli.run_setup import Health
from hil_bench.errors import BusError, ConfigError
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.realtime.statistics import TickStatistics

if TYPE_CHECKING:
    from hil_bench.outside.recording.channels import Channel


# The feed of work that is no running bench: what is being done, its values, and a stop.
#
# A commissioning, a twin, tests and a campaign have no tick between which they could look for
# clients. A thread of its own does that here, ten times a second.

_LOOK = 0.1  # [s]
_STATES = 5  # looks between two states


class WorkFeed:
    """Shows work to those who watch it, as a context manager.

    Args:
        process: of the server.
        plan: that of the server.
        stop: called when somebody asks for the end, in another thread.
    """

    def __init__(self, process: FeedProcess, plan: FeedPlan, stop: Callable[[], None]) -> None:
        self._process = process
        self._plan = plan
        self._stop = stop
        self._lock = threading.Lock()  # two threads write into one ring
        self._over = threading.Event()
        self._served = threading.Event()
        self._wanted = 0
        self._state = WorkState().content()
        self._shown: dict[str, object] | None = None
        self._row: Sequence[float] | None = None
        self._begin = time.monotonic()
        self._time = 0.0
        self._journal = Journal()
        self._looks = 0
        self._thread = threading.Thread(target=self._run, name="hil-bench-work", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        if self._wanted:
            self._publish(is_due=True)
        self._process.stop()

    def wait_for_client(self, timeout: float) -> None:
        """Wait until somebody watches the rows, but no longer than this [s]."""
        self._served.wait(timeout)

    def show(self, state: WorkState) -> None:
        """Show from now on how the work goes."""
        self._state = state.content()

    def put_row(self, values: Sequence[float]) -> None:
        """Show a row: time [s], then a value a channel in its SI unit; any thread but ours."""
        self._time, self._row = values[0], values
        if self._wanted & messages.WANTS_ROWS:
            self._put(messages.ROW, self._plan.row.pack(*values))

    def look(self) -> None:
        """Take requests, and publish what is due."""
        if not self._process.look():
            self._wanted = 0
            return
        for kind, message in self._plan.down.take():
            if kind == messages.WANTS:
                self._shown = None
                self._wanted = message[0]
                if self._wanted & messages.WANTS_ROWS:
                    self._served.set()
            elif kind == messages.COMMAND:
                self._obey(json.loads(message))
        if self._wanted:
            self._looks += 1
            self._publish(is_due=self._shown is None or self._looks % _STATES == 0)

    def _run(self) -> None:
        while not self._over.wait(_LOOK):
            self.look()

    def _publish(self, *, is_due: bool) -> None:
        row = self._row
        if row is not None and not self._wanted & messages.WANTS_ROWS:
            self._put(messages.ROW, self._plan.row.pack(*row))
        now = self._now()
        self._put(messages.HEALTH, messages.encode({"time": now, "lost": self._plan.up.lost}))
        if is_due and self._state != self._shown:
            nothing: dict[str, object] = {"nodes": {}, "ecus": {}, "faults": [], "recording": None}
            state = {"time": now, **nothing, "work": self._state}
            if self._put(messages.STATE, messages.encode(state)):
                self._shown = self._state

    def _now(self) -> float:
        """Return the time of the newest row or, without any, since the beginning [s]."""
        return time.monotonic() - self._begin if self._row is None else self._time

    def _obey(self, content: Mapping[str, Any]) -> None:
        action, ticket = content["do"], content["ticket"]
        answer: dict[str, object] = {"ticket": ticket, "value": None}
        if action == "mark":
            entry = self._journal.add(round(self._now() * 1e9), action, content["fields"])
            self._put(messages.ACTED, messages.encode(entry))
        elif action == "journal":
            answer["value"] = self._journal.content()
        elif action != "stop":
            verb = self._plan.hello["work"]["verb"]
            error = f"{action}: this is {verb}, no running bench; it takes mark, status and stop"
            answer = {"ticket": ticket, "error": error, "kind": "usage"}
        self._put(messages.ANSWER, messages.encode(answer))
        if action == "stop":
            self._stop()

    def _put(self, kind: int, message: bytes) -> bool:
        with self._lock:
            return self._plan.up.put(kind, message)


# The feed of `hil-bench run`: its name, and what it says of the bench.

logger = logging.getLogger(__name__)

_MOST_NAMES = 100
_FAREWELL = 3.0  # for a panel to end [s]


@contextlib.contextmanager
def watched_run(
    args: argparse.Namespace,
    config: BenchConfig,
    session: Session,
    *,
    statistics: TickStatistics | None = None,
    health: Health = dict,
    work: ShownWork | None = None,
) -> Iterator[Callable[[], None] | None]:
    """Let people watch a session in the block; see `cli.run_setup`.

    Yields:
        What is to be called after each tick; None where there is no feed.
    """
    place = None if args.no_feed or not HAS_SOCKETS else take_place(args.name, NAME)
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
        yield feed.look


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
        "bus_rates": [[bus.bitrate or USUAL_BITRATE, bus.speedup] for bus in config.buses.values()],
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


def add_work_arguments(parser: argparse.ArgumentParser, verb: str) -> None:
    """Add what concerns those who watch the work; see `common.work`."""
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
    """Let people watch work in the block; see `common.work`.

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
