"""Runs in processes of their own, which are killed where they take too long.

A worker leads a session that its controllers' programs are in, so that all end together. One that
dies costs the run that it was at, and another one takes its place.
"""

import enum
import gc
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from time import monotonic
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

from hil_bench.abilities.common.processes import living
from hil_bench.abilities.controllers.standstill import report_instead
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.errors import ConfigError, HilBenchError
from hil_bench.outside.helper_process import HelperProcess


class TaskEnd(enum.Enum):
    """The end of a task that gave no result."""

    TIMED_OUT = enum.auto()
    CRASHED = enum.auto()


class Spec(Protocol):
    """A task that a pool can do."""

    @property
    def timeout(self) -> float:
        """The time limit of a run [s]."""


SpecT = TypeVar("SpecT", bound=Spec)
ResultT = TypeVar("ResultT")


class _Standstill(NamedTuple):
    """Said by a worker whose controller never comes back, as it ends."""

    words: str


_START_TIME = 120.0  # that a worker may take to start [s]
_LONGEST_WAIT = 0.5  # [s]
_ROUNDS = 100
_OBJECTS = 100_000
"""New ones after which cycles are collected during a task; as a rule they are between two."""


class _Task(NamedTuple):
    spec: Any
    deadline: float


class Pool(Generic[SpecT, ResultT]):
    """Processes that do runs, or other tasks.

    Args:
        jobs: how many, 1 or more.
        perform: does a task; a function of a module. Its `ConfigError` ends all.
        failed: makes the result of a task that was ended by a time-out or a crash.
    """

    def __init__(
        self,
        jobs: int,
        perform: Callable[[SpecT], ResultT],
        failed: Callable[[SpecT, TaskEnd, str], ResultT],
    ) -> None:
        self._jobs = jobs
        self._perform, self._failed = perform, failed
        self._idle: list[_Worker[SpecT, ResultT]] = []
        self._busy: list[_Worker[SpecT, ResultT]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes, whatever they do."""
        for worker in (*self._idle, *self._busy):
            worker.kill()
        self._idle, self._busy = [], []

    def __call__(self, specs: Iterable[SpecT]) -> Iterator[ResultT]:
        """Do tasks.

        Yields:
            What came of each, in the order in which they end.
        """
        waiting = iter(specs)
        is_exhausted = False
        while True:
            while not is_exhausted and len(self._busy) < self._jobs:
                spec = next(waiting, None)
                if spec is None:
                    is_exhausted = True
                else:
                    worker = self._idle.pop() if self._idle else self._start()
                    worker.give(spec)
                    self._busy.append(worker)
            if not self._busy:
                return
            yield from self._collect()

    def _start(self) -> "_Worker[SpecT, ResultT]":
        return _Worker(self._perform, self._failed)

    def _collect(self) -> Iterator[ResultT]:
        """Wait for the next that end.

        Yields:
            What came of them.
        """
        until = min(worker.deadline for worker in self._busy)
        ready = [worker.fileno() for worker in self._busy]
        wait(ready, min(max(until - monotonic(), 0.0), _LONGEST_WAIT))
        for worker in list(self._busy):
            result = worker.look()
            if result is not None:
                self._busy.remove(worker)
                if worker.is_alive:
                    self._idle.append(worker)
                yield result


class _Worker(Generic[SpecT, ResultT]):
    """A process that does one task after the other; see `Pool`."""

    def __init__(
        self, perform: Callable[[SpecT], ResultT], failed: Callable[[SpecT, TaskEnd, str], ResultT]
    ) -> None:
        self._failed = failed
        self._process = HelperProcess(_work, (perform,), name="hil-bench worker")
        self._process.start()
        self._task: _Task | None = None
        self._is_ready = False

    @property
    def is_alive(self) -> bool:
        """True if the worker can take another run."""
        return self._process.alive

    @property
    def deadline(self) -> float:
        """When its run has taken too long, on the machine's clock [s]."""
        return self._task.deadline if self._task else monotonic()

    def fileno(self) -> int:
        """Return the descriptor that is readable when it has a result."""
        return self._process.fileno()

    def give(self, spec: SpecT) -> None:
        """Let it do a task."""
        patience = spec.timeout if self._is_ready else _START_TIME
        self._task = _Task(spec, monotonic() + patience)
        self._process.send(spec)

    def look(self) -> ResultT | None:
        """Return the outcome of its task; None where that is still open.

        Raises:
            ConfigError: the files are not those of the campaign, or no process can start.
        """
        if self._task is None:
            return None
        spec: SpecT = self._task.spec
        try:
            answer = self._process.receive(0.0)
        except TimeoutError:
            if monotonic() < self._task.deadline:
                return None
            self.kill()
            problem = f"has taken more than {spec.timeout:g} s"
            return self._failed(spec, TaskEnd.TIMED_OUT, problem)
        except EOFError:
            self.kill()
            ending = self._process.ending()
            if not self._is_ready:
                right = 'a script needs `if __name__ == "__main__":`; jobs=0 needs no process'
                raise ConfigError(
                    f"a process for runs {ending} before its first run; {right}"
                ) from None
            return self._failed(spec, TaskEnd.CRASHED, f"its process {ending}")
        if isinstance(answer, str):
            raise ConfigError(answer)
        result: ResultT | None = None
        if answer is None:  # the process has started, and the time of its first run begins
            self._is_ready = True
            self._task = _Task(spec, monotonic() + spec.timeout)
        elif isinstance(answer, _Standstill):
            self.kill()
            result = self._failed(spec, TaskEnd.TIMED_OUT, answer.words)
        else:
            self._task, result = None, answer
        return result

    def kill(self) -> None:
        """End it, and all that it has started."""
        if self._process.pid is not None:
            _kill_session(self._process.pid)
        self._process.stop(0.0)


def _work(perform: Callable[[Any], object], connection: Connection) -> None:
    """Do the tasks that come, until the parent lets go."""
    os.setsid()
    os.dup2(2, 1)  # what controllers print is no result
    report_instead(lambda words: connection.send(_Standstill(words)))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logging.getLogger().setLevel(logging.CRITICAL)  # thousands of runs say what one would say
    with suppress(HilBenchError), VirtualBench() as bench:
        bench.run(0.002)  # compiles the plant, which is no run's time
    connection.send(None)
    gc.set_threshold(_OBJECTS)
    with suppress(EOFError):
        connection.send(_answer(perform, connection.recv()))
        gc.collect()
        gc.freeze()  # modules, and what runs have in common
        while True:
            connection.send(_answer(perform, connection.recv()))
            gc.collect()
    _kill_session(os.getpid())


def _answer(perform: Callable[[Any], object], spec: object) -> object:
    try:
        return perform(spec)
    except ConfigError as error:
        return str(error)


def _end_with_parent() -> None:
    """End this process, and all that it has started, once its parent is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        _kill_session(os.getpid())


def _kill_session(leader: int) -> None:
    """Kill a worker and what it has started, which is in its session, in whatever group.

    Where the system lists no processes, only those of the worker's own group are found.
    """
    for _ in range(_ROUNDS):  # one that is to be killed may start another meanwhile
        others = [each.pid for each in living() if each.session == leader != each.pid]
        if not others:
            break
        for each in others:
            with suppress(OSError):
                os.kill(each, signal.SIGKILL)
    with suppress(OSError):  # it has not become a leader yet, or is gone
        os.killpg(leader, signal.SIGKILL)
