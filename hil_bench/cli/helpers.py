"""The helper processes of a run: says when one has ended, and starts it again.

A look costs the loop next to nothing. Starting is slow, so another thread does it; that thread
exists only meanwhile. A helper that ends again and again is given up.
"""

import logging
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from time import monotonic_ns
from typing import TYPE_CHECKING, Protocol

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import HilBenchError

if TYPE_CHECKING:
    import argparse


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
