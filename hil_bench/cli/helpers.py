"""The helper processes of a run, and what happens on its bench, in words."""

import logging
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import zip_longest
from time import monotonic_ns
from typing import TYPE_CHECKING, Protocol

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.events import EventWatch, event_text
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.words import emergency_text
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import HilBenchError

if TYPE_CHECKING:
    import argparse


# Watches the processes beside a loop: says when one has ended, and starts it again.
#
# A look costs the loop next to nothing. Starting is slow, so another thread does it; that thread
# exists only meanwhile. A helper that ends again and again is given up.

logger = logging.getLogger(__name__)

LOOK = 100_000_000
"""Time between two looks [ns]."""

DELAYS = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Time before each new start [s]; after the last one a helper is given up."""

SOUND = 60_000_000_000
"""Time that a helper has to run after a new start so that earlier ones do not count any more [ns].
"""


def add_loss_argument(parser: "argparse._ActionsContainer") -> None:
    """Add the argument that says what follows when something is lost."""
    parser.add_argument(
        "--end-on-loss",
        action="store_true",
        help="end when a recording cannot be written on, or a process beside the loop dies (hub, "
        f"Modbus server, recorder, status lines), with exit code {ExitCode.LOST}; without it the "
        "run goes on, and what can be started again is",
    )


class Helper(Protocol):
    """A process beside the loop."""

    @property
    def name(self) -> str:
        """The name of the helper, as in "Modbus server"."""

    @property
    def loss(self) -> str:
        """The consequence of its end for the user, and the remedy."""

    @property
    def is_needed(self) -> bool:
        """True if a run without the helper is not the run that was asked for."""

    def ending(self) -> str | None:
        """Return the way it ended, as in "was killed (SIGKILL)"; None while it runs."""

    def restart(self) -> str:
        """Start it again and return where it is found; `HilBenchError` where that fails.

        Another thread calls it.
        """


class Helpers:
    """The helpers of a run.

    Args:
        helpers: they run.
        ends_on_loss: whether the run is to end with the first of them, or with its recording.
        has_lost_data: says whether the recording is incomplete.
        clock: [ns].

    Attributes:
        is_over: whether the run is to end.
    """

    def __init__(
        self,
        helpers: Sequence[Helper],
        *,
        ends_on_loss: bool = False,
        has_lost_data: Callable[[], bool] = lambda: False,
        clock: Callable[[], int] = monotonic_ns,
    ) -> None:
        self.is_over = False
        self._watches = [_Watch(helper, is_final=ends_on_loss) for helper in helpers]
        self._ends_on_loss = ends_on_loss
        self._has_lost_data = has_lost_data
        self._clock = clock
        self._look_at = clock()

    @property
    def code(self) -> ExitCode:
        """The exit code: of a run that ended by a loss, or without a helper that is needed."""
        is_incomplete = self.is_over or any(watch.is_missed for watch in self._watches)
        return ExitCode.LOST if is_incomplete else ExitCode.DONE

    def look(self) -> None:
        """Look after the helpers, where the last look is long enough ago; to be called often."""
        now = self._clock()
        if now < self._look_at:
            return
        self._look_at = now + LOOK
        for watch in self._watches:
            watch.look(now)
        if self._ends_on_loss:
            self.is_over |= self._has_lost_data() or any(watch.is_down for watch in self._watches)

    def close(self) -> None:
        """Wait until nobody starts anything any more."""
        for watch in self._watches:
            watch.wait()

    def lines(self) -> list[str]:
        """Return the helpers that ended, a line each."""
        return [line for watch in self._watches for line in watch.lines()]


class _Watch:
    """The state of one helper."""

    def __init__(self, helper: Helper, *, is_final: bool) -> None:
        self.is_down = False
        self._helper = helper
        self._is_final = is_final
        self._processors = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
        self._endings: list[str] = []
        self._tries = 0
        self._start_at: int | None = None
        self._started_at = 0
        self._start: _Start | None = None

    @property
    def is_missed(self) -> bool:
        """True if the helper is needed and does not run."""
        return self.is_down and self._helper.is_needed

    def look(self, now: int) -> None:
        """Take the next step: notice its end, start it, or notice how that went."""
        if self._start is not None:
            if self._start.is_over:
                self._take_outcome(self._start, now)
        elif self._start_at is not None:
            if now >= self._start_at:
                self._start_at = None
                self._start = _Start(self._helper, self._processors)
        elif not self.is_down and (ending := self._helper.ending()) is not None:
            self._take_end(ending, now)

    def wait(self) -> None:
        """Wait for a start that is under way."""
        if self._start is not None:
            self._start.wait()

    def lines(self) -> list[str]:
        """Return the number of its endings and the last one, in a line."""
        if not self._endings:
            return []
        times = "once" if len(self._endings) == 1 else f"{len(self._endings)} times"
        rest = "does not run any more" if self.is_down else "runs again"
        return [f"{self._helper.name} ended {times}, last: {self._endings[-1]}; {rest}"]

    def _take_end(self, ending: str, now: int) -> None:
        self.is_down = True
        self._endings.append(ending)
        if now - self._started_at >= SOUND:
            self._tries = 0
        self._say(f"its process {ending}; {self._helper.loss}; {self._plan(now)}")

    def _take_outcome(self, start: "_Start", now: int) -> None:
        self._start = None
        if start.error is None:
            self.is_down = False
            self._started_at = now
            self._say(f"runs again{f' ({start.found})' if start.found else ''}")
        else:
            self._say(f"cannot be started again: {start.error}; {self._plan(now)}")

    def _plan(self, now: int) -> str:
        """Decide what follows, and return it in words."""
        if self._is_final:
            return "the run ends (--end-on-loss)"
        if self._tries == len(DELAYS):
            return f"given up after {self._tries} new starts; the run goes on without"
        delay = DELAYS[self._tries]
        self._tries += 1
        self._start_at = now + round(delay * 1e9)
        return f"the run goes on, and a new start follows in {delay:g} s"

    def _say(self, what: str) -> None:
        say = logger.error if self._helper.is_needed else logger.warning
        say("%s: %s", self._helper.name, what)


class _Start:
    """A start that is under way, in a thread.

    Args:
        helper: to be started.
        processors: on which it may run, whatever the loop is tied to; None for no matter.

    Attributes:
        found: where the helper is found.
        error: why it cannot be started; None where it runs.
    """

    def __init__(self, helper: Helper, processors: set[int] | None) -> None:
        self.found = ""
        self.error: str | None = "an error of hil-bench"
        self._helper = helper
        self._processors = processors
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """True if it has come to an end."""
        return not self._thread.is_alive()

    def wait(self) -> None:
        """Wait for that."""
        self._thread.join()

    def _run(self) -> None:
        if self._processors is not None:  # what is started inherits them
            with suppress(OSError):
                os.sched_setaffinity(0, self._processors)
        try:
            self.found = self._helper.restart()
        except (HilBenchError, OSError) as error:
            self.error = str(error)
        else:
            self.error = None


# Events of a running bench as lines for people: faults, states, errors, SYNC.

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
