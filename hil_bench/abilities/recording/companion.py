"""A recording beside a run: what `hil-bench run --record` adds to it."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict

from hil_bench.abilities.recording.options import recording_code, recording_wish, report_lines
from hil_bench.abilities.recording.recorder import RecordingSink
from hil_bench.abilities.recording.sessions import recorded
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.session.session import Session


class RunRecording:
    """The recording of a run.

    Args:
        sink: takes it; None where nobody asks for one.
        hears_all: whether it wants all frames of the bus.

    Attributes:
        hears_all: as passed in.
    """

    def __init__(self, sink: RecordingSink | None, *, hears_all: bool) -> None:
        self.hears_all = hears_all
        self._sink = sink

    @property
    def code(self) -> ExitCode:
        """The exit code of a run with it: that of lost data where some are missing by now."""
        return recording_code(None if self._sink is None else self._sink.report)

    def lines(self) -> list[str]:
        """Return its content, a line a fact."""
        return [] if self._sink is None else report_lines(self._sink.report)

    def content(self) -> dict[str, object]:
        """Return its report; None where there is none."""
        if self._sink is None:
            return {"recording": None}
        report = self._sink.report
        return {"recording": asdict(report) | {"is_complete": report.is_complete}}


@contextmanager
def accompany(
    args: argparse.Namespace, session: Session, config: BenchConfig, *, is_real_time: bool
) -> Iterator[RunRecording]:
    """Record a run as its command line says.

    Args:
        args: the command line.
        session: not yet started.
        config: of the bench.
        is_real_time: whether ticks must not wait for a disk.

    Yields:
        The recording.
    """
    wish = recording_wish(args)
    with recorded(session, wish, config, is_real_time=is_real_time) as sink:
        yield RunRecording(sink, hears_all=args.whole_bus)
