"""The live status line.

It is a process of its own that reads a snapshot, so that the loop never waits for a terminal.
"""

import multiprocessing
import shutil
import signal
import sys
from collections.abc import Sequence
from multiprocessing.synchronize import Event
from types import TracebackType
from typing import NamedTuple, Self

from hil_bench.bench import Bench
from hil_bench.realtime.statistics import TickStatistics
from hil_bench.recording.channels import Channel
from hil_bench.recording.snapshot import Snapshot

REFRESH = 0.1
"""Time between two refreshes [s]."""

_END_TIMEOUT = 2.0
_CLEAR_LINE = "\r\x1b[K"


class Field(NamedTuple):
    """How one value of a row is shown.

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
        fields: one a value of the row.
        wanted: False turns it off, as for ``--quiet``.
    """

    def __init__(self, snapshot: Snapshot, fields: Sequence[Field], *, wanted: bool = True) -> None:
        context = multiprocessing.get_context("spawn")
        self._ended = context.Event()
        self._process = context.Process(
            target=show,
            args=(snapshot, tuple(fields), self._ended),
            name="hil-bench-status",
            daemon=True,
        )
        self._wanted = wanted and sys.stderr.isatty()

    def __enter__(self) -> Self:
        if self._wanted:
            self._process.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self._wanted:
            return
        self._ended.set()
        self._process.join(_END_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def show(snapshot: Snapshot, fields: tuple[Field, ...], ended: Event) -> None:
    """Write the newest row until `ended` is set; signals are the parent's to act on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    while not ended.wait(REFRESH) and parent is not None and parent.is_alive():
        row = snapshot.read()
        if row is not None:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(_CLEAR_LINE + format_row(row.values, fields)[:width])
            sys.stderr.flush()
    sys.stderr.write(_CLEAR_LINE)
    sys.stderr.flush()


def format_row(values: Sequence[float], fields: Sequence[Field]) -> str:
    """Return the values of a row, each in its template."""
    return "  ".join(
        field.template.format(value * field.scale)
        for value, field in zip(values, fields, strict=True)
    )


def bench_status(bench: Bench) -> tuple[list[Channel], list[Field]]:
    """Return what the status line shows of each axis: the channels, and how they are written."""
    channels, fields = [], []
    for axis in bench.axes:
        label = f"{axis.name} " if len(bench.axes) > 1 else ""
        for name, unit, template, scale in (
            ("position", "m", label + "x {:+8.2f} mm", 1e3),
            ("P_A", "Pa", "P_A {:5.1f}", 1e-5),
            ("P_B", "Pa", "P_B {:5.1f} bar", 1e-5),
            ("spool_position", "-", "spool {:+6.1f} %", 100.0),
        ):
            channels.append(Channel(f"{axis.name}.{name}", unit))
            fields.append(Field(template, scale))
    return channels, fields


def bench_status_row(bench: Bench) -> list[float]:
    """Return the present values of the channels of `bench_status`."""
    row: list[float] = []
    for axis in bench.axes:
        output = axis.plant.output
        row += (output.x, output.P_A, output.P_B, output.nu / axis.valve.full_opening)
    return row


def loop_status() -> tuple[list[Channel], list[Field]]:
    """Return what the status line shows of the loop's health."""
    channels = [Channel("latest", "s"), Channel("overruns", "-")]
    return channels, [Field("late max {:.0f} us", 1e6), Field("{:.0f} overran", 1.0)]


def loop_status_row(statistics: TickStatistics) -> tuple[float, float]:
    """Return the present values of the channels of `loop_status`."""
    return statistics.lateness.maximum * 1e-9, statistics.overruns
