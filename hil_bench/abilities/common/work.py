"""The view of work for people, by the ability that shows it."""

import argparse
import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from hil_bench.ability import given_to
from hil_bench.bench.session import Session
from hil_bench.outside.realtime.clock import MonotonicClock

if TYPE_CHECKING:
    from hil_bench.outside.recording.channels import Channel, RowSink

MOST_ITEMS = 200
"""Most items of a state: those that are worth it come first."""


class WorkItem(NamedTuple):
    """A part of the work, or something that it found.

    Attributes:
        name: of a step, a requirement, a quantity.
        verdict: "runs" for the one that runs; empty where there is none yet.
        text: what is to be said of it.
    """

    name: str
    verdict: str = ""
    text: str = ""


class Band(NamedTuple):
    """The range in which a requirement wants a channel.

    Attributes:
        channel: its name.
        low: the least right value [SI]; None without one.
        high: the largest [SI]; None without one.
        begin: from when on [s].
        end: until when [s]; None for the end of the run.
        is_strict: whether the channel must be in it all that time; else at some time of it, or
            after a trigger.
    """

    channel: str
    low: float | None
    high: float | None
    begin: float = 0.0
    end: float | None = None
    is_strict: bool = True


class WorkMargin(NamedTuple):
    """The margin of a requirement so far.

    Attributes:
        id: of the requirement.
        verdict: passed or failed where that is decided already; else empty.
        margin: as a share of the tolerance, below zero where it is violated; None where unknown.
        text: the margin in a unit, and when it came about.
        bands: what it wants of channels.
    """

    id: str
    verdict: str
    margin: float | None
    text: str
    bands: Sequence[Band] = ()


class Histogram(NamedTuple):
    """The distribution of a requirement's margins.

    Attributes:
        name: of the requirement.
        low: lower edge of the first bin, as a share of the tolerance.
        high: upper edge of the last bin.
        counts: runs of each bin.
        below: runs below the first bin.
        above: runs above the last bin.
    """

    name: str
    low: float
    high: float
    counts: Sequence[int]
    below: int = 0
    above: int = 0


class Course(NamedTuple):
    """A curve of the work, such as the best margin so far of a search.

    Attributes:
        name: of the method.
        points: number of the run and margin, as a share of the tolerance.
    """

    name: str
    points: Sequence[tuple[float, float]]


class Failure(NamedTuple):
    """A run that failed, with what repeats it.

    Attributes:
        key: of the run.
        name: of its scenario, and the values of its parameters.
        text: what went wrong.
        command: repeats it in a shell.
    """

    key: str
    name: str
    text: str
    command: str


class WorkState(NamedTuple):
    """The progress of work.

    Attributes:
        now: what is being done; empty where nothing is.
        detail: how, in words: the limits of a step.
        done: parts that are done, or time that has passed.
        total: all parts; 0 where nobody knows.
        unit: of both; empty for parts.
        left: remaining time [s]; None where nobody knows.
        counts: how many there are of what.
        items: parts or findings, see `MOST_ITEMS`.
        limits: lowest and highest value of channels, in SI.
        margins: of the requirements so far.
        histograms: of margins over runs.
        courses: of a search.
        failures: runs that failed, the worst first, see `MOST_ITEMS`.
        verdict: at the end.
    """

    now: str = ""
    detail: str = ""
    done: float = 0
    total: float = 0
    unit: str = ""
    left: float | None = None
    counts: Mapping[str, int] = {}
    items: Sequence[WorkItem] = ()
    limits: Mapping[str, tuple[float, float]] = {}
    margins: Sequence[WorkMargin] = ()
    histograms: Sequence[Histogram] = ()
    courses: Sequence[Course] = ()
    failures: Sequence[Failure] = ()
    verdict: str = ""

    def content(self) -> dict[str, object]:
        """Return it as clients get it."""
        margins = [
            {**each._asdict(), "bands": [band._asdict() for band in each.bands]}
            for each in self.margins[:MOST_ITEMS]
        ]
        return {
            **self._asdict(),
            "items": [each._asdict() for each in self.items[:MOST_ITEMS]],
            "margins": margins,
            "histograms": [each._asdict() for each in self.histograms],
            "courses": [each._asdict() for each in self.courses],
            "failures": [each._asdict() for each in self.failures[:MOST_ITEMS]],
        }


# Those who watch work that is no running bench.


class Watchers(Protocol):
    """People who see how work goes."""

    def show(self, state: WorkState) -> None:
        """Show from now on how it goes."""

    def put_row(self, values: Sequence[float]) -> None:
        """Show a row: time [s], then a value a channel in its SI unit."""


class WorkView:
    """The view of work for people; nobody looks without --panel or --name.

    Args:
        feed: where it is shown; None for nowhere.
    """

    def __init__(self, feed: "Watchers | None" = None) -> None:
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

    def __init__(self, recording: "RowSink | None", view: WorkView) -> None:
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
    """Add what concerns those who watch the work of a verb.

    Args:
        parser: of the verb.
        verb: its name, by which others find it.
    """
    for module in given_to("view"):
        module.add_work_arguments(parser, verb)


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
    """
    for module in given_to("view"):
        with module.watched_work(args, verb, title, channels, again) as view:
            yield view
        return
    yield WorkView()


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
