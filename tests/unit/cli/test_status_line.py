"""What the status line says; the process that writes it is tried on a pseudo-terminal."""

import math
import os
import pty
import signal
import sys
from pathlib import Path
from types import SimpleNamespace

from support.bus_side import BusSide

from hil_bench import VirtualBench, load_config
from hil_bench.cli.status_line import (
    REFRESH,
    Field,
    StatusLine,
    bench_status,
    bench_status_row,
    bus_status,
    bus_status_row,
    format_health,
    format_row,
    in_place,
    show,
)
from hil_bench.outside.helper_process import Snapshot
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.outside.transports.transport import TransportCounters


def test_it_shows_each_quantity_with_its_unit():
    bus = BusSide()
    _, fields = bench_status(bus.bench)
    # Rest at mid-stroke: P_A A_A = P_B A_B around 50 bar, A_A = 5e-3, A_B = 4.7e-3 m² (Table I):
    # P_A = 50 * 4.7 / 4.85 = 48.45, P_B = 50 * 5 / 4.85 = 51.55 bar.
    text = format_row(bench_status_row(bus.bench), fields)
    assert text == "x    +0.00 mm  P_A  48.5  P_B  51.5 bar  spool   +0.0 %"


def test_of_two_axes_each_has_its_name_before_its_first_quantity():
    two = Path(__file__).parents[3] / "examples" / "two_axes.toml"
    with VirtualBench(load_config(two)) as bench:
        channels, fields = bench_status(bench.bench)
        assert len(channels) == len(fields) == 2 * len(bench_status(BusSide().bench)[1])
        text = format_row(bench_status_row(bench.bench), fields)
    first, second = (axis.name for axis in load_config(two).axes)
    assert text.startswith(f"{first} x ")
    assert f"  {second} x " in text
    assert (text.count(first), text.count(second)) == (1, 1)


def test_a_value_that_is_not_there_is_a_dash_in_its_column():
    field = Field("nanny set {:+8.2f} mm", 1e3)
    shown, absent = (format_row([value], [field]) for value in (-0.01, math.nan))
    assert shown == "nanny set   -10.00 mm"
    assert absent == "nanny set        - mm"


def test_nothing_is_minus_zero():
    with VirtualBench() as bench:
        fields = bench_status(bench.bench)[1]
    assert "-" not in format_row([-1e-9] * len(fields), fields)


def test_it_shows_the_health_of_the_loop():
    statistics = TickStatistics()
    for lateness in (*[70_000] * 99, 123_400):
        statistics.lateness.record(lateness)
    statistics.work.record(50_000)
    statistics.overruns, statistics.skipped = 2, 1
    # 70,000 ns lie in a bin of 512 ns, that ends with 70,143: 70 us.
    assert format_health(statistics) == [
        "late p99 70 max 123 us  work p99 50 max 50 us  2 overran  1 skipped"
    ]
    assert format_health(None) == []


def test_it_shows_the_traffic_of_the_bus():
    counters = TransportCounters(received=1234, sent=56)
    text = format_row(bus_status_row(counters, 0.1234), bus_status()[1])
    assert text == "in 1234  out 56  bus 12.3 %"


def test_it_is_silent_where_nobody_looks(capfd):
    channels, fields = bus_status()
    with StatusLine(Snapshot(len(channels)), [fields]):
        pass
    assert capfd.readouterr() == ("", "")


def test_it_writes_the_newest_row_to_a_terminal(monkeypatch):
    channels, fields = bus_status()
    snapshot = Snapshot(len(channels))
    snapshot.write((7, 5, 0.5))
    statistics = TickStatistics(is_shared=True)
    statistics.overruns = 3
    reader, terminal = pty.openpty()
    stderr = os.dup(2)
    os.dup2(terminal, 2)
    try:
        with os.fdopen(os.dup(2), "w") as stream, monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", stream)
            with StatusLine(snapshot, [fields[:2], fields[2:]], statistics=statistics):
                shown = b""
                while not shown.endswith(b"\x1b[A\x1b[A"):
                    shown += os.read(reader, 1024)
    finally:
        os.dup2(stderr, 2)
        for descriptor in (stderr, reader, terminal):
            os.close(descriptor)
    # A terminal makes a line feed a carriage return, too. Down twice is up twice.
    assert shown.endswith(
        b"\r\x1b[Jin 7  out 5\r\nbus 50.0 %\r\n"
        b"late p99 0 max 0 us  work p99 0 max 0 us  3 overran  0 skipped\x1b[A\x1b[A"
    )


def test_each_row_takes_the_place_of_the_last_until_the_loop_lets_go(capsys):
    channels, fields = bus_status()
    snapshot, rows = Snapshot(len(channels)), [(7, 5, 0.5), (8, 6, 0.25)]
    waits = []

    def poll(wait):
        waits.append(wait)
        if rows:
            snapshot.write(rows.pop(0))
        return len(waits) > 2

    show(snapshot, (tuple(fields),), None, SimpleNamespace(poll=poll))
    assert capsys.readouterr().err == (
        "\r\x1b[Jin 7  out 5  bus 50.0 %\r\x1b[Jin 8  out 6  bus 25.0 %\r\x1b[J"
    )
    assert waits == [REFRESH] * 3


def test_one_that_was_killed_says_so_is_started_anew_and_holds_nothing_up(monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    channels, fields = bus_status()
    with StatusLine(Snapshot(len(channels)), [fields]) as line:
        assert line.ending() is None
        os.kill(line.pid, signal.SIGKILL)
        while line.ending() is None:  # pytest-timeout ends it otherwise
            os.sched_yield()
        assert line.ending().startswith("was killed (SIGKILL")
        line.restart()
        assert line.ending() is None
        os.kill(line.pid, signal.SIGKILL)
    assert line.ending().startswith("was killed (SIGKILL")


def test_no_line_is_longer_than_the_terminal_is_wide():
    assert in_place(["123456789", "ab"], 8) == "\r\x1b[J1234567\nab\x1b[A"
