"""A requirement held against a whole run, with all that led to its margin."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hil_bench.scenario import nodes
from hil_bench.scenario.build import window_ticks
from hil_bench.scenario.explain import Cause, Explainer, Log
from hil_bench.scenario.monitor import Monitor
from hil_bench.scenario.nodes import Condition
from hil_bench.scenario.sliding import Floats

_HEAD = 8192  # ticks that come first: what they decide needs no more


class Examination:
    """A requirement and a run.

    Args:
        requirement: the condition.
        columns: the values of each signal that it names, shape (ticks,); NaN where unknown.
        ticks: how many.
        tick_ns: time between two [ns].

    Attributes:
        monitor: that has seen the whole run.
    """

    def __init__(
        self, requirement: Condition, columns: Mapping[str, Floats], ticks: int, tick_ns: int
    ) -> None:
        self._requirement, self._ticks, self._tick_ns = requirement, ticks, tick_ns
        self._log = Log()
        self.monitor = Monitor(requirement, tick_ns, self._log.wrap)
        for start, end in ((0, min(_HEAD, ticks)), (_HEAD, ticks)):
            part = {name: column[start:end] for name, column in columns.items()}
            self.monitor.push(part, max(0, end - start))
        self.monitor.finish()

    def find_cause(self) -> Cause:
        """Return what decides; only where the requirement is decided."""
        is_failed = self.monitor.is_failed
        explainer = Explainer(self._log, self._tick_ns, self._ticks, is_failed=is_failed)
        return explainer.find(self._requirement)

    def violated_spans(self) -> list[tuple[int, int]]:
        """Return first and last tick of each time in which the requirement is violated.

        Only a requirement that says of each tick that it must hold has such times.
        """
        edges = np.diff(self._violated(self._requirement).astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return list(zip(starts.tolist(), ends.tolist(), strict=True))

    def _violated(self, node: Condition) -> npt.NDArray[np.bool_]:
        found = np.zeros(self._ticks, dtype=np.bool_)
        if isinstance(node, nodes.All):
            for operand in node.operands:
                found |= self._violated(operand)
        elif isinstance(node, nodes.Always):
            start, end = window_ticks(node, node.window, self._tick_ns)
            stop = self._ticks if end is None else min(self._ticks, end + 1)
            part = self._log.margins(node.operand).high[start:stop] < 0.0
            found[start : start + len(part)] = part
        return found
