"""What the status line says; the process that writes it is tried on a pseudo-terminal."""

import os
import pty
import sys

from support.bus_side import BusSide

from hil_bench.cli.status_line import (
    StatusLine,
    bench_status,
    bench_status_row,
    format_row,
    loop_status,
    loop_status_row,
)
from hil_bench.realtime.statistics import TickStatistics
from hil_bench.recording.snapshot import Snapshot


def test_it_shows_each_quantity_with_its_unit():
    bus = BusSide()
    _, fields = bench_status(bus.bench)
    # Rest at mid-stroke: P_A A_A = P_B A_B around 50 bar, A_A = 5e-3, A_B = 4.7e-3 m² (Table I):
    # P_A = 50 * 4.7 / 4.85 = 48.45, P_B = 50 * 5 / 4.85 = 51.55 bar.
    text = format_row(bench_status_row(bus.bench), fields)
    assert text == "x    +0.00 mm  P_A  48.5  P_B  51.5 bar  spool   +0.0 %"


def test_it_shows_the_health_of_the_loop():
    statistics = TickStatistics()
    statistics.lateness.record(123_400)
    statistics.overruns = 2
    text = format_row(loop_status_row(statistics), loop_status()[1])
    assert text == "late max 123 us  2 overran"


def test_it_is_silent_where_nobody_looks(capfd):
    channels, fields = loop_status()
    with StatusLine(Snapshot(channels), fields):
        pass
    assert capfd.readouterr() == ("", "")


def test_it_writes_the_newest_row_to_a_terminal(monkeypatch):
    channels, fields = loop_status()
    snapshot = Snapshot(channels)
    snapshot.write((5e-6, 3.0))
    reader, terminal = pty.openpty()
    stderr = os.dup(2)
    os.dup2(terminal, 2)
    try:
        with os.fdopen(os.dup(2), "w") as stream, monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", stream)
            with StatusLine(snapshot, fields):
                shown = b""
                while b"overran" not in shown:
                    shown += os.read(reader, 1024)
    finally:
        os.dup2(stderr, 2)
        for descriptor in (stderr, reader, terminal):
            os.close(descriptor)
    assert b"late max 5 us  3 overran" in shown
