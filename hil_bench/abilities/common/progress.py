"""Progress of work: a line now and then, or a bar where there is a terminal."""

import argparse
import logging
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from select import select
from time import monotonic_ns
from typing import TypeVar

logger = logging.getLogger(__name__)

WORK_PERIOD = 10_000_000_000
"""Time between two lines of all other work, likewise [ns]."""

_NS_PER_S = 1_000_000_000

_PartT = TypeVar("_PartT")

_LOOK_S = 0.5  # between two looks at work; a bar moves as often


class Work:
    """Work of many parts, as far as it is.

    Args:
        title: in a word.
        total: number of parts; None where nobody knows it.
        unit: their name, in the plural.

    Attributes:
        title: likewise.
        total: likewise.
        unit: likewise.
        done: parts that are done; to be counted up by who works.
        stage: the part that is being done, in words; likewise.
        remark: of what was done, such as "2 failed"; likewise.
        is_waiting: whether somebody is asked, and the terminal is theirs; likewise.
    """

    def __init__(self, title: str, total: int | None = None, unit: str = "parts") -> None:
        self.title, self.total, self.unit = title, total, unit
        self.done = 0
        self.stage = self.remark = ""
        self.is_waiting = False

    def begin(self, stage: str) -> None:
        """Name what is done next, and count it when the next one begins."""
        self.done += bool(self.stage)
        self.stage = stage

    def line(self, elapsed: int) -> str:
        """Return the progress after a time [ns], in a line."""
        of_all = "" if self.total is None else f" of {self.total}"
        parts = f"{self.done}{of_all} {self.unit}, " if self.done or of_all else ""
        words = [f"{parts}{elapsed // _NS_PER_S} s", self.remark, self.stage]
        return f"{self.title}: {'; '.join(filter(None, words))}"


def counted(work: Work, parts: Iterable[_PartT]) -> Iterator[_PartT]:
    """Yield parts, each counted as done once the next is asked for."""
    for part in parts:
        yield part
        work.done += 1


class WorkLines:
    """Says every ten seconds how far work is.

    Args:
        work: which.
        say: takes each line.
        clock: of the machine [ns].
        pauses: say it only where no part was done for as long, for each is printed.
    """

    def __init__(
        self,
        work: Work,
        say: Callable[[str], None] = logger.warning,
        clock: Callable[[], int] = monotonic_ns,
        *,
        pauses: bool = False,
    ) -> None:
        self._work, self._say, self._clock, self._pauses = work, say, clock, pauses
        self._seen = work.done
        self._start = clock()
        self._due = self._start + WORK_PERIOD

    def look(self) -> None:
        """Say how far it is, where it is time; to be called often."""
        present = self._clock()
        if self._pauses and (
            self._work.done != self._seen or self._work.is_waiting or not _takes_more()
        ):
            self._seen, self._due = self._work.done, present + WORK_PERIOD
        if present >= self._due:
            self._due += WORK_PERIOD
            self._say(self._work.line(present - self._start))

    def close(self) -> None:
        """End."""


def _takes_more() -> bool:
    """Return False while who reads the results, such as a pager, has all that a pipe holds."""
    try:
        return bool(select([], [sys.stdout], [], 0.0)[1])
    except (OSError, TypeError, ValueError):  # no file, or none that can be asked
        return True


class WorkBar:
    """Shows on a terminal how far work is; needs tqdm."""

    def __init__(self, work: Work) -> None:
        from tqdm import tqdm  # noqa: PLC0415 - an extra

        self._work = work
        self._bar = tqdm(total=work.total, desc=work.title, unit=f" {work.unit}", leave=False)

    def look(self) -> None:
        """Show how far it is; to be called often."""
        self._bar.n = self._work.done
        words = filter(None, (self._work.remark, self._work.stage))
        self._bar.set_postfix_str("; ".join(words))

    def close(self) -> None:
        """Leave the terminal to the results."""
        self._bar.close()


@contextmanager
def shown_work(args: argparse.Namespace, work: Work, *, pauses: bool = False) -> Iterator[Work]:
    """Show on standard error how far work is, in the block; nothing under --quiet.

    Args:
        args: the command line, with `quiet`.
        work: which.
        pauses: whether the verb prints each part when it is done: lines only where one takes long.

    Yields:
        The work, to be counted up.
    """
    if args.quiet:
        yield work
        return
    has_bar = not pauses and sys.stderr.isatty() and find_spec("tqdm") is not None
    shown = WorkBar(work) if has_bar else WorkLines(work, pauses=pauses)
    over = threading.Event()

    def look() -> None:
        while not over.wait(_LOOK_S):
            shown.look()

    thread = threading.Thread(target=look, name="hil-bench-progress", daemon=True)
    thread.start()
    try:
        yield work
    finally:
        over.set()
        thread.join()
        shown.close()
