"""The events of a bench, as the begin and the end of a fault: since when, and over what time."""

from collections.abc import Iterator
from itertools import takewhile

from hil_bench.bench.bench import Bench, Event
from hil_bench.outside.recording.channels import Span


def event_text(event: Event) -> str:
    """Return an event in words, as in "freeze pressure_a begins"."""
    return f"{event.name} {event.verb}"


def event_content(event: Event) -> dict[str, object]:
    """Return an event for programs, its time in seconds."""
    return {"time": event.time * 1e-9, **event.content}


class EventWatch:
    """Finds what is new among the events of a bench.

    Args:
        bench: the bench.
    """

    def __init__(self, bench: Bench) -> None:
        self._logs = bench.events
        self._last: dict[str, Event] = {}

    def news(self) -> Iterator[Event]:
        """Yield the events since the last call, oldest first; all that are kept in the first."""
        for name, log in self._logs.items():
            last = self._last.get(name)
            fresh = list(takewhile(lambda event, last=last: event is not last, reversed(log)))  # type: ignore[misc]
            for event in reversed(fresh):
                self._last[name] = event
                yield event


def event_spans(bench: Bench, now: float) -> list[Span]:
    """Return the times of a bench from the begin to the end of something.

    Args:
        bench: the bench.
        now: the end of what has not ended [s].
    """
    spans: list[Span] = []
    for log in bench.events.values():
        begun: dict[str, Event] = {}
        for event in log:
            if event.is_begin:
                begun[event.name] = event
            elif event.name in begun:
                spans.append(_span(begun.pop(event.name), event.time * 1e-9))
        spans += [_span(event, now) for event in begun.values()]
    return spans


def _span(begin: Event, end: float) -> Span:
    return Span(begin.time * 1e-9, end, f"{begin.name}{begin.note}")
