"""Events of a running bench as lines for people: faults, states, errors, SYNC."""

from collections.abc import Callable, Iterable, Iterator
from itertools import zip_longest

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.events import EventWatch, event_text
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.words import emergency_text
from hil_bench.cli.helpers import LOOK

SYNC_PATIENCE = 1_000_000_000
"""Time without SYNC after which it counts as lost [ns]."""

MOST_LINES = 20
"""Lines that may follow one another; then it is one a second."""

_TWICE = (
    "another device sends with the same identifiers: the node-ID is twice on the bus, as with two "
    "benches; 'hil-bench scan' shows them"
)

_NS_PER_S = 1_000_000_000


class BenchEvents:
    """Says what happens on a bench.

    Args:
        config: of the bench.
        bench: the bench.
        say: takes each line.
        watches_sync: whether SYNC is missed when it stays away; others say so where it lets time
            pass.
    """

    def __init__(
        self,
        config: BenchConfig,
        bench: Bench,
        say: Callable[[str], None],
        *,
        watches_sync: bool = True,
    ) -> None:
        self._nodes = [
            _NodeWatch(settings.name, node, fitting.state)
            for settings, node, fitting in zip(
                config.nodes, bench.nodes, bench.fittings, strict=True
            )
        ]
        self._events = EventWatch(bench)
        self._sync = _SyncWatch(bench.nodes) if watches_sync else None
        self._budget = _Budget(say)
        self._look_at = 0

    def look(self, now: int) -> None:
        """Say what has happened since the last look, where that is long enough ago.

        Args:
            now: bench time [ns].
        """
        if now < self._look_at:
            return
        self._look_at = now + LOOK
        for event in self._events.news():
            self._say(now, event.time, f"{event.what} {event_text(event)}")
        changed: dict[str, list[str]] = {}
        for node in self._nodes:
            if change := ", ".join(node.changes()):
                changed.setdefault(change, []).append(node.name)
        for change, names in changed.items():
            self._say(now, now, f"{', '.join(names)}: {change}")
        if self._sync is not None and (what := self._sync.change(now)):
            self._say(now, now, what)

    def _say(self, now: int, time: int, what: str) -> None:
        self._budget.say(now, f"{time / _NS_PER_S:.3f} s: {what}")


class _NodeWatch:
    """The last observed state of a node."""

    def __init__(self, name: str, node: Node, device_state: Callable[[], str] | None) -> None:
        self.name = name
        self._node = node
        self._device_state = device_state
        self._states: tuple[str, ...] | None = None
        self._errors: frozenset[int] = frozenset()
        self._problem: str | None = None
        self._is_alone = True

    def changes(self) -> Iterator[str]:
        """Yield what has changed since the last call; where the node began is no change.

        Yields:
            A change in words.
        """
        yield from self._state_changes()
        errors = self._node.errors
        for code in sorted(errors - self._errors):
            yield f"EMCY 0x{code:04X} ({emergency_text(code)})"
        for code in sorted(self._errors - errors):
            yield f"EMCY 0x{code:04X} gone"
        self._errors = errors
        if self._is_alone and self._node.counters.foreign_frames:
            self._is_alone = False
            yield _TWICE
        problem = self._node.storage_problem
        if problem is not None and problem != self._problem:
            yield problem
        self._problem = problem

    def _state_changes(self) -> Iterator[str]:
        is_off = self._states is not None and not self._node.has_power  # since it began
        if self._node.state is NmtState.INITIALISING and not is_off:
            return
        states = [self._node.state_name]
        if self._device_state is not None and not is_off:
            states.append(self._device_state())
        before, self._states = self._states, tuple(states)
        if before is not None:
            yield from (new for old, new in zip_longest(before, states) if new and new != old)


class _SyncWatch:
    """The watch on SYNC: its loss and return, where it ever came."""

    def __init__(self, nodes: Iterable[Node]) -> None:
        self._nodes = tuple(nodes)
        self._count = 0
        self._last = 0
        self._is_lost = False

    def change(self, now: int) -> str:
        """Return that SYNC is lost or back [ns]; empty for neither."""
        count = max((node.syncs for node in self._nodes), default=0)
        silence = (now - self._last) / _NS_PER_S
        if count != self._count:
            was_lost, self._is_lost = self._is_lost, False
            self._count, self._last = count, now
            return f"SYNC is back after {silence:.1f} s" if was_lost else ""
        if count and not self._is_lost and now - self._last >= SYNC_PATIENCE:
            self._is_lost = True
            return f"no SYNC for {silence:.1f} s; PDOs that wait for it stand still"
        return ""


class _Budget:
    """Lets so many lines through as a person can read."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._free_at = 0
        self._left_out = 0

    def say(self, now: int, line: str) -> None:
        """Say a line, or count it."""
        if self._free_at - now >= MOST_LINES * _NS_PER_S:
            self._left_out += 1
            return
        more = f" ({self._left_out} lines left out before)" if self._left_out else ""
        self._say(line + more)
        self._left_out = 0
        self._free_at = max(self._free_at, now) + _NS_PER_S
