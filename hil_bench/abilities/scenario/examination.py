"""A requirement held against a whole run, with all that led to its margin."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.build import window_ticks
from hil_bench.abilities.scenario.coverage import View
from hil_bench.abilities.scenario.explain import Cause, Explainer, Log
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.nodes import Condition
from hil_bench.abilities.scenario.reach import breadth
from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.abilities.scenario.syntax import DEEPEST
from hil_bench.abilities.scenario.values import Block

_HEAD = 8192  # ticks that come first: what they decide needs no more


class Examination:
    """A requirement and a run.

    Args:
        requirement: the condition.
        columns: the values of each signal that it names, shape (ticks,); NaN where unknown.
        ticks: how many of them were seen.
        tick_ns: time between two [ns].
        planned: how many ticks the run has; those behind the ones seen are unknown. None for a run
            that ends with what was seen.

    Attributes:
        monitor: that has seen the whole run.
        view: how much of the requirement's time was seen.
        values: the values of each signal, up to where nothing changes any more.
        violated: how many ticks that were seen violate it, where they add up to a time; else 0.
    """

    def __init__(
        self,
        requirement: Condition,
        columns: Mapping[str, Floats],
        ticks: int,
        tick_ns: int,
        planned: int | None = None,
    ) -> None:
        ticks = ticks if planned is None else min(ticks, planned)
        unseen = 0 if planned is None else min(planned - ticks, _settling(requirement, tick_ns))
        seen = {name: column[:ticks] for name, column in columns.items()}
        self.values = Block(
            {n: _padded(column, unseen) for n, column in seen.items()}, ticks + unseen
        )
        self._requirement, self._ticks, self._tick_ns = requirement, ticks + unseen, tick_ns
        self._log = Log()
        self.monitor = Monitor(requirement, tick_ns, self._log.wrap)
        self._seen, self.violated = ticks, 0
        for start, end in pairwise(sorted({0, min(_HEAD, ticks), ticks, self._ticks})):
            part = {name: column[start:end] for name, column in self.values.columns.items()}
            self.monitor.push(part, end - start)
            found = self.monitor.violation
            if found is not None and found.lasts and end <= ticks:
                self.violated = found.ticks
        self.monitor.finish()
        self.view = View(self.monitor.asked, seen, ticks, tick_ns, planned)

    def find_cause(self) -> Cause:
        """Return the cause of the decision; only where the requirement is decided."""
        is_failed = self.monitor.is_failed
        explainer = Explainer(self._log, self._tick_ns, self._ticks, is_failed=is_failed)
        return explainer.find(self._requirement)

    def violated_spans(self) -> list[tuple[int, int]]:
        """Return first and last tick of each time in which the requirement is violated.

        Only a requirement that says of each tick that it must hold has such times; of the run, what
        was seen.
        """
        found = self._violated(self._requirement)[: self._seen]
        edges = np.diff(found.astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return list(zip(starts.tolist(), ends.tolist(), strict=True))

    def idle_wait(self) -> str:
        """Say that a fulfilled requirement waits for what was so from the start; else nothing.

        It is looked for where the requirement is a wait itself, or one behind each of its triggers.
        """
        match self._requirement:
            case nodes.Eventually() | nodes.Until() as wait:
                starts, when = np.zeros(1, dtype=np.intp), "from the start"
            case nodes.Always(
                window=window,
                operand=nodes.Implies(trigger, nodes.Eventually() | nodes.Until() as wait),
            ):
                start, end = window_ticks(self._requirement, window, self._tick_ns)
                asked = self._log.margins(trigger).low[start : None if end is None else end + 1]
                starts, when = np.flatnonzero(asked > 0.0) + start, "at each trigger already"
            case _:
                return ""
        goal = wait.goal if isinstance(wait, nodes.Until) else wait.operand
        low = self._log.margins(goal).low
        first = starts + window_ticks(wait, wait.window, self._tick_ns)[0]
        is_idle = first.size and first.max() < low.size and np.all(low[first] > 0.0)
        return f"what it waits for was so {when}" if is_idle else ""

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


def _settling(requirement: Condition, tick_ns: int) -> int:
    """Return after how many ticks that are all unknown another one changes nothing.

    By then each window lies in them as a whole. A level rounds it up by a tick, or looks a tick
    back.
    """
    return breadth(requirement) // tick_ns + DEEPEST


def _padded(column: Floats, count: int) -> Floats:
    """Return a column with unknown values behind it."""
    return np.concatenate((column, np.full(count, np.nan))) if count else column
