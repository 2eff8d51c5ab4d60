"""The faults of a session as ranges of time, and as events in its recordings."""

import logging
from collections.abc import Iterable

from hil_bench.devices.faults.schedule import FaultEvent
from hil_bench.outside.recording.report import RecordingReport
from hil_bench.outside.recording.spans import Span

logger = logging.getLogger(__name__)


def ranges_of(events: Iterable[FaultEvent], now: float) -> list[Span]:
    """Return begin and end of each fault by its events.

    Args:
        events: in the order of time.
        now: the end of one that has not ended [s].
    """
    spans: list[Span] = []
    begun: dict[tuple[object, str], float] = {}
    for event in events:
        key, time = (event.kind, event.target), event.time * 1e-9
        if event.is_begin:
            begun[key] = time
        elif key in begun:
            spans.append(Span(begun.pop(key), time, f"{event.kind} {event.target}"))
    return spans + [Span(start, now, f"{kind} {target}") for (kind, target), start in begun.items()]


def write_faults(report: RecordingReport, ranges: list[Span]) -> None:
    """Append faults to the MF4 files of a recording that has ended; a problem is a line."""
    if not ranges:
        return
    from hil_bench.outside.recording.mdf_events import (  # noqa: PLC0415 - takes NumPy with it
        append_events,
    )

    for file in report.files:
        if file.path.suffix.lower() != ".mf4" or file.problem:
            continue
        try:
            append_events(file.path, ranges)
        except OSError as error:
            logger.warning("%s: its faults are not in it: %s", file.path, error.strerror or error)
