"""The part of a run before its first tick, files and a bus, and the content that it reports."""

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from hil_bench.ability import given_to
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.bench.configuration.records import Served
from hil_bench.bench.events import event_content
from hil_bench.bench.paced import RunReport
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session, open_session
from hil_bench.cli import exit_codes
from hil_bench.cli.devices import device_table
from hil_bench.cli.helpers import Helper, Helpers
from hil_bench.cli.process import collection_put_off
from hil_bench.cli.results import print_results, warn_of
from hil_bench.errors import ConfigError, HilBenchError, about_file, check_replaceable, naming
from hil_bench.outside.bits import USUAL_BITRATE, load_of
from hil_bench.outside.realtime.statistics import DurationHistogram, TickStatistics, TickSummary
from hil_bench.outside.transports.opening import JoinedTransport, open_transport
from hil_bench.outside.transports.socketcan import SocketCanTransport, bitrate_of
from hil_bench.outside.transports.transport import Transport, TransportCounters

# The bench's own end of its buses: those that are there, or a hub that it hosts.

HUB_CHANNEL = "can0"


class OpenBus(NamedTuple):
    """The bus of a bench, or its buses, open.

    Attributes:
        transport: the bench's end of it, or of all of them as one.
        parts: each bus by its name in the configuration.
        lines: what a controller engineer needs to know to join.
        helpers: the process of its hub.
        bitrate: that the load refers to, of all buses together [bit/s].
    """

    transport: Transport
    parts: Mapping[str, Transport]
    lines: tuple[str, ...]
    helpers: Sequence[Helper]
    bitrate: int


OpenBuses = Callable[[argparse.Namespace, BenchConfig], AbstractContextManager[OpenBus]]
"""Opens the buses of a bench by the command line."""


@contextlib.contextmanager
def open_bus(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenBus]:
    """Open the buses of the configuration, or host as many and join them.

    Yields:
        The buses.

    Raises:
        ConfigError: nothing here hosts a bus.
    """
    with contextlib.ExitStack() as stack:
        if args.hub is None:
            yield _open_configured(config, stack)
            return
        for module in given_to("hub"):
            yield module.open_hub(args, config, stack)
            return
        raise ConfigError("--hub: nothing here hosts a bus: the ability hub is missing")


def _open_configured(config: BenchConfig, stack: contextlib.ExitStack) -> OpenBus:
    parts = {}
    for name, bus in config.buses.items():
        parts[name] = open_transport(*bus.address)
        stack.callback(parts[name].close)
    bitrate = sum(
        bus.bitrate or own_bitrate(parts[name]) or USUAL_BITRATE
        for name, bus in config.buses.items()
    )
    return OpenBus(joined(parts), parts, bus_lines(parts), (), bitrate)


def joined(parts: Mapping[str, Transport]) -> Transport:
    """Return several buses as one, and a single one as it is."""
    transports = tuple(parts.values())
    return transports[0] if len(transports) == 1 else JoinedTransport(transports)


def bus_lines(parts: Mapping[str, Transport]) -> tuple[str, ...]:
    """Return the description of each bus, with its name where there are several."""
    if len(parts) == 1:
        return tuple(f"bus    {part.description}" for part in parts.values())
    return tuple(f"bus    {name}: {part.description}" for name, part in parts.items())


def own_bitrate(transport: Transport) -> int | None:
    """Return the bit rate that a SocketCAN interface is set to [bit/s], None where it has none."""
    return bitrate_of(transport.channel) if isinstance(transport, SocketCanTransport) else None


# Common parts of both ways to `hil-bench run`: the set-up before the first tick, and the end.


class Companion(Protocol):
    """An ability at work beside a run, as one that records it.

    Attributes:
        hears_all: whether it wants all frames of the bus, and not only those of the bench.
    """

    hears_all: bool

    @property
    def code(self) -> exit_codes.ExitCode:
        """The exit code of the run by now, as far as it is concerned."""

    def lines(self) -> list[str]:
        """Return the lines that it adds to the summary."""
        ...

    def content(self) -> Mapping[str, object]:
        """Return its part of the summary for a program."""
        ...


class RunSetup(NamedTuple):
    """A bench that is about to run, and what is open around it.

    Attributes:
        args: the command line.
        config: of the bench.
        session: the bench, not yet powered on.
        bus: its buses.
        served: what its parts have opened for others.
        companions: what abilities do beside it.
        wish: whether somebody wants the end.
    """

    args: argparse.Namespace
    config: BenchConfig
    session: Session
    bus: OpenBus
    served: Sequence[Served]
    companions: Sequence[Companion]
    wish: exit_codes.Interruption

    def watch(self, *helpers: Helper) -> Helpers:
        """Return the guard of the processes of this run, and of further ones."""
        return Helpers(
            [*self.bus.helpers, *(each for part in self.served for each in part.helpers), *helpers],
            ends_on_loss=self.args.end_on_loss,
            has_lost_data=lambda: self.code is not exit_codes.ExitCode.DONE,
        )

    def announcement(self) -> Callable[[], None]:
        """Return a callable that shows a controller engineer, once, the way to join.

        The text is made now, when there is no tick yet to hold up. Standard output is left to the
        summary where a program reads it.
        """
        left = [] if self.args.quiet else [introduction(self.config, self.bus, self.served)]
        stream = sys.stderr if self.args.json else sys.stdout

        def announce() -> None:
            while left:
                print(left.pop(), file=stream, flush=True)

        return announce

    def finish(
        self,
        ending: exit_codes.Ending,
        helpers: Helpers,
        lost: HilBenchError | None,
        lines: Iterable[str],
        content: Mapping[str, object],
    ) -> exit_codes.ExitCode:
        """Print the summary and the error that ended the run, and return the exit code."""
        with ending.going_on():
            print_results(self.args, lines, content)
        ending.take_error(lost)
        ending.take(self.code, helpers.code, self.wish.code)
        return ending.code

    def companion_lines(self) -> list[str]:
        """Return the lines that its companions add to the summary."""
        return [line for each in self.companions for line in each.lines()]

    @property
    def code(self) -> exit_codes.ExitCode:
        """The exit code of the run, as far as its companions are concerned."""
        return exit_codes.worst(*(each.code for each in self.companions))


@contextlib.contextmanager
def set_up(
    args: argparse.Namespace,
    config: BenchConfig,
    *,
    is_real_time: bool,
    open_buses: OpenBuses = open_bus,
) -> Iterator[RunSetup]:
    """Build the bench and open its buses, what its parts serve, and its companions.

    Args:
        args: the command line.
        config: of the bench.
        is_real_time: whether ticks must not wait for companions.
        open_buses: opens its buses.

    Yields:
        All that.
    """
    warn_of(find_doubts(config))
    with collection_put_off():
        session = open_session(config)
    with contextlib.ExitStack() as stack:
        stack.callback(session.door.close)
        wish = stack.enter_context(exit_codes.interruption())
        bus = stack.enter_context(open_buses(args, config))
        served = []
        for part in config.parts:
            if (opened := part.served(session, config)) is not None:
                served.append(stack.enter_context(opened))
            else:
                stack.enter_context(part.attached(session, config))
        # Last: a recording replaces that of the run before, which one that cannot begin shall not.
        companions = [
            stack.enter_context(module.accompany(args, session, config, is_real_time=is_real_time))
            for module in given_to("run")
        ]
        yield RunSetup(args, config, session, bus, served, companions, wish)


def introduction(config: BenchConfig, bus: OpenBus, served: Sequence[Served]) -> str:
    """Return the introduction of the bench for a controller engineer who joins."""
    source = config.path or "built-in bench"
    plant = f"{config.steps_per_tick} plant steps a tick" if config.axes else "no axis"
    rate = f"{1e9 / config.tick_ns:g} Hz, {plant}"
    lines = [f"bench  {source}, {rate}", *bus.lines]
    lines += [line for part in served for line in part.lines]
    lines += [line for part in config.parts for line in part.lines]
    return "\n".join((*lines, "", device_table(config), ""))


# Those who watch a bench that runs.

Health = Callable[[], Mapping[str, float]]
"""Returns counters of the bus, and what else says how the loop is."""


@contextlib.contextmanager
def watched_run(
    args: argparse.Namespace,
    config: BenchConfig,
    session: Session,
    *,
    statistics: TickStatistics | None = None,
    health: Health = dict,
    work: object = None,
) -> Iterator[Callable[[], None] | None]:
    """Let people watch a session in the block.

    Args:
        args: the command line.
        config: of the bench.
        session: to be watched.
        statistics: of the loop, shared.
        health: asked ten times a second while somebody watches.
        work: what is played on it, as they take it; None where nothing is.

    Yields:
        What is to be called after each tick; None where nobody can watch.
    """
    for module in given_to("view"):
        opened = module.watched_run(
            args, config, session, statistics=statistics, health=health, work=work
        )
        with opened as look:
            yield look
        return
    yield None


# The timing of a run as a file for programs: summary and histograms in JSON.


class HistogramFile:
    """A file that is looked at before the run and written after it.

    Args:
        path: the file; None for none.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        if path is None:
            return
        check_replaceable(path)
        with about_file(f"--histograms {path}", right="give a file in a directory of yours"):
            path.open("a").close()  # what is in it stays until `write`

    def write(self, report: RunReport, period_ns: int, bitrate: int) -> None:
        """Write what a run did."""
        if self._path is not None:
            with naming(self._path), self._path.open("w", encoding="ascii") as file:
                json.dump(timing(report, period_ns, bitrate), file, indent=1)
                file.write("\n")


def timing(report: RunReport, period_ns: int, bitrate: int) -> dict[str, Any]:
    """Return the timing of a run: counts, and for each duration percentiles and bins."""
    ticks = report.ticks
    elapsed = (ticks.ticks + ticks.skipped) * period_ns
    statistics = report.statistics
    return figures(ticks, period_ns) | {
        "lateness": asdict(ticks.lateness) | {"bins": bins(statistics.lateness)},
        "work": asdict(ticks.work) | {"bins": bins(statistics.work)},
        "frames": asdict(report.frames),
        "bus_load": load_of(report.frames.bits, elapsed, bitrate),
        "bitrate": bitrate,
        "ended_by": None if report.lost is None else str(report.lost),
    }


def figures(ticks: TickSummary, period_ns: int) -> dict[str, Any]:
    """Return the figures of a loop: counts, and percentiles of each duration."""
    return {
        "tick_us": period_ns / 1000,
        "ticks": ticks.ticks,
        "overruns": ticks.overruns,
        "skipped": ticks.skipped,
        "lateness": asdict(ticks.lateness),
        "work": asdict(ticks.work),
    }


def bins(histogram: DurationHistogram) -> list[dict[str, float]]:
    """Return the bins that are not empty: largest value [us], and count."""
    return [{"to_us": edge, "count": count} for edge, count in histogram.bins()]


# The `hil-bench run --json` output: the figures of the summary, for a program.

_S_PER_NS = 1e-9


def paced_content(
    report: RunReport, setup: RunSetup, helpers: Helpers, *, is_timed: bool
) -> dict[str, object]:
    """Return the figures of a run by the clock.

    Args:
        report: of the run.
        setup: the bench, and what was open around it.
        helpers: the processes beside the loop.
        is_timed: whether there was a time by which ticks were due.
    """
    period, bitrate = setup.config.tick_ns, setup.bus.bitrate
    elapsed = (report.ticks.ticks + report.ticks.skipped) * period
    timing = ("lateness", "work")
    loop = figures(report.ticks, period)
    return {
        "bench_time": elapsed * _S_PER_NS,
        "loop": {key: loop[key] for key in loop if is_timed or key not in timing},
        "held": list(report.held),
        "bus_load": load_of(report.frames.bits, elapsed, bitrate),
        "bitrate": bitrate,
        **common_content(report.frames, report.lost, setup, helpers),
    }


def common_content(
    frames: TransportCounters, lost: HilBenchError | None, setup: RunSetup, helpers: Helpers
) -> dict[str, object]:
    """Return the figures of a run, whatever made its ticks.

    Args:
        frames: that passed the bus.
        lost: why it ended early; None where it did not.
        setup: the bench, and what was open around it.
        helpers: the processes beside the loop.
    """
    bench = setup.session.bench
    medium = bench.medium
    standing = (lambda _device: None) if medium is None else medium.standing
    return {
        "ended_by": None if lost is None else str(lost),
        "frames": asdict(frames) | {"for_nobody": bench.unrouted},
        "buses": {name: part.counters() for name, part in setup.bus.parts.items()},
        **{name: [event_content(each) for each in log] for name, log in bench.events.items()},
        "nodes": [
            {
                "name": settings.name,
                "node_id": node.node_id,
                "state": node.state_name,
                "refused": node.counters,
                "can": standing(node),
                "storage_problem": node.storage_problem,
            }
            for settings, node in zip(setup.config.nodes, bench.nodes, strict=True)
        ],
        "ecus": [
            {
                "name": name,
                **ecu.standing(),
                "can": standing(ecu.ecu),
            }
            for name, ecu in peers_of(bench).items()
        ],
        **{name: each for part in setup.companions for name, each in part.content().items()},
        "helpers": helpers.lines(),
    }
