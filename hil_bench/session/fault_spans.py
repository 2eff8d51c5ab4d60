"""The times of faults of a virtual bench, for figures."""

from hil_bench.outside.recording.spans import Span
from hil_bench.session.fault_ranges import ranges_of
from hil_bench.session.virtual_bench import VirtualBench


def fault_spans(bench: VirtualBench) -> list[Span]:
    """Return begin and end of each fault of a bench; one that has not ended lasts until now."""
    return ranges_of(bench.faults.events, bench.now())
