"""The status line of a run, and the progress of long work."""

import contextlib
import math
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from time import monotonic_ns
from typing import NamedTuple, Self

from hil_bench.bench.bench import Bench
from hil_bench.outside.helper_process import HelperProcess, Snapshot
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.outside.recording.channels import Channel
from hil_bench.outside.transports.transport import TransportCounters

# The live status: some lines that are written over, in place.
#
# It is a process of its own that reads a snapshot, so that the loop never waits for a terminal.

REFRESH = 0.1
"""Time between two refreshes [s]."""

_END_TIMEOUT = 2.0
_CLEAR_BELOW = "\r\x1b[J"
_LINE_UP = "\x1b[A"


class Field(NamedTuple):
    """The format of one value of a row.

    Attributes:
        template: its text, as in ``"P_A {:6.1f} bar"``.
        scale: what the SI value is multiplied with before.
    """

    template: str
    scale: float


class StatusLine:
    """Shows the newest row of a snapshot on standard error while it is entered.

    Only on a terminal: elsewhere it does nothing.

    Args:
        snapshot: what the loop writes.
        lines: the fields of each line, together one a value of the row.
        statistics: of the loop, shared; None shows none.
        wanted: False turns it off, as for ``--quiet``.

    Attributes:
        is_shown: whether it is wanted, and there is a terminal.
    """

    name = "status lines"
    loss = "nothing else is touched"
    is_needed = False

    def __init__(
        self,
        snapshot: Snapshot,
        lines: Sequence[Sequence[Field]],
        *,
        statistics: TickStatistics | None = None,
        wanted: bool = True,
    ) -> None:
        self._arguments = (snapshot, tuple(map(tuple, lines)), statistics)
        self._helper = self._new_helper()
        self.is_shown = wanted and sys.stderr.isatty()

    @property
    def pid(self) -> int | None:
        """Identifier of its process, None where there is none."""
        return self._helper.pid

    def __enter__(self) -> Self:
        if self.is_shown:
            self._helper.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._helper.stop(_END_TIMEOUT)

    def ending(self) -> str | None:
        """Return the way its process ended, as in "was killed (SIGKILL)"; None while it runs."""
        return self._helper.ending()

    def restart(self) -> str:
        """Start a new process in the place of one that has ended."""
        self._helper.stop(_END_TIMEOUT)
        self._helper = self._new_helper()
        self._helper.start()
        return ""

    def _new_helper(self) -> HelperProcess:
        return HelperProcess(show, self._arguments, name="hil-bench-status")


def show(
    snapshot: Snapshot,
    lines: tuple[tuple[Field, ...], ...],
    statistics: TickStatistics | None,
    connection: Connection,
) -> None:
    """Write the newest row until the loop lets go of the connection, or the terminal closes."""
    with contextlib.suppress(OSError):
        while not connection.poll(REFRESH):
            row = snapshot.read()
            if row is not None:
                texts = format_lines(row.values, lines) + format_health(statistics)
                sys.stderr.write(in_place(texts, shutil.get_terminal_size().columns))
                sys.stderr.flush()
        sys.stderr.write(_CLEAR_BELOW)
        sys.stderr.flush()


def in_place(texts: Sequence[str], columns: int) -> str:
    """Return text that overwrites the previous lines on a terminal of so many columns."""
    cut = [text[: columns - 1] for text in texts]
    return _CLEAR_BELOW + "\n".join(cut) + _LINE_UP * (len(cut) - 1)


def format_lines(values: Sequence[float], lines: Sequence[Sequence[Field]]) -> list[str]:
    """Return the values of a row, line by line."""
    rest = iter(values)
    return [format_row([next(rest) for _ in fields], fields) for fields in lines]


def format_row(values: Sequence[float], fields: Sequence[Field]) -> str:
    """Return the values of a row, each in its template."""
    return "  ".join(map(format_value, values, fields))


def format_value(value: float, field: Field) -> str:
    """Return a value in its template; one that is not there is a "-" in the number's place."""
    text = field.template.format(value * field.scale)
    if not math.isnan(value):
        return text
    label, _, unit = text.rpartition("nan")
    return f"{label.replace('+', ' ')}  -{unit}"


def format_health(statistics: TickStatistics | None) -> list[str]:
    """Return the line on the loop's health, from its histograms; none where there is no loop."""
    if statistics is None:
        return []
    facts = [
        *(
            f"{name} p99 {duration.percentile(99):.0f} max {duration.maximum / 1e3:.0f} us"
            for name, duration in (("late", statistics.lateness), ("work", statistics.work))
        ),
        f"{statistics.overruns} overran",
        f"{statistics.skipped} skipped",
    ]
    return ["  ".join(facts)]


def bench_status(bench: Bench) -> tuple[list[Channel], list[Field]]:
    """Return the status line's channels of each axis, and their formats."""
    channels, fields = [], []
    for axis in bench.axes:
        label = f"{axis.name} " if len(bench.axes) > 1 else ""
        for quantity in axis.recorded:
            if quantity.shown is not None:
                channels.append(Channel(f"{axis.name}.{quantity.name}", quantity.unit))
                fields.append(Field(label + quantity.shown.template, quantity.shown.scale))
                label = ""
    return channels, fields


def bench_status_row(bench: Bench) -> list[float]:
    """Return the present values of the channels of `bench_status`."""
    row: list[float] = []
    for axis, commanded in zip(bench.axes, bench.commands, strict=True):
        pairs = zip(axis.recorded, axis.row(commanded), strict=True)
        row += (value for quantity, value in pairs if quantity.shown is not None)
    return row


def bus_status() -> tuple[list[Channel], list[Field]]:
    """Return the status line's channels of the bus, and their formats."""
    channels = [Channel("received", "-"), Channel("sent", "-"), Channel("bus_load", "-")]
    return channels, [
        Field("in {:.0f}", 1.0),
        Field("out {:.0f}", 1.0),
        Field("bus {:.1f} %", 100.0),
    ]


def bus_status_row(counters: TransportCounters, load: float) -> tuple[float, float, float]:
    """Return the present values of the channels of `bus_status`."""
    return counters.received, counters.sent, load


# Progress of a run: a line now and then.


PERIOD = 60_000_000_000
"""Time between two lines of a run, on the machine's clock [ns]."""


_MOST_TEXT = 120
_GAP = re.compile(r"  +(?=[^\W\d])")  # before the name of a value


class Progress:
    """Says how a run goes.

    Args:
        say: takes each line.
        lines: returns what the status lines would show at a bench time [ns].
        clock: of the machine [ns].
    """

    def __init__(
        self,
        say: Callable[[str], None],
        lines: Callable[[int], Sequence[str]],
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._say = say
        self._lines = lines
        self._clock = clock
        self._due = clock() + PERIOD

    def look(self, now: int) -> None:
        """Say how it goes, where it is time; to be called often.

        Args:
            now: bench time [ns].
        """
        present = self._clock()
        if present >= self._due:
            self._due = present + PERIOD
            self._say(f"{now / 1e9:.3f} s: {'  '.join(map(_shortened, self._lines(now)))}")


def _shortened(text: str) -> str:
    """Return a status line with the values for which it has room, and how many it leaves out."""
    begins = [0, *(gap.start() for gap in _GAP.finditer(text)), len(text)]
    left_out = sum(end > _MOST_TEXT for end in begins)
    return f"{text[: begins[-left_out - 1]]}  and {left_out} more" if left_out else text
