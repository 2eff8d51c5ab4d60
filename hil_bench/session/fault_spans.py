"""When which fault was there, for figures."""

from hil_bench.outside.recording.plot import Span
from hil_bench.session.virtual_bench import VirtualBench


def fault_spans(bench: VirtualBench) -> list[Span]:
    """Return when which fault was there; one that has not ended lasts until now."""
    spans: list[Span] = []
    begun: dict[tuple[object, str], float] = {}
    for event in bench.faults.events:
        key, time = (event.kind, event.target), event.time * 1e-9
        if event.is_begin:
            begun[key] = time
        elif key in begun:
            spans.append(Span(begun.pop(key), time, f"{event.kind} {event.target}"))
    now = bench.now()
    return spans + [Span(start, now, f"{kind} {target}") for (kind, target), start in begun.items()]
