"""Runs of a campaign, alone, from a snapshot, and in a pool of processes."""

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from hil_bench.abilities.campaign.plan import nested
from hil_bench.abilities.campaign.records import Case, RunOutcome, RunResult, RunSpec, Verdict
from hil_bench.abilities.campaign.store import case_digest, controller_digest
from hil_bench.abilities.controllers.desk import ControllerConfig, Desks
from hil_bench.abilities.controllers.section import ControllersConfig
from hil_bench.abilities.controllers.standstill import watch_nothing
from hil_bench.abilities.scenario.judgement import WORST_FIRST
from hil_bench.abilities.scenario.pool import Pool, TaskEnd
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.resolve import PreparedScenario, TimedAction, parameter_values
from hil_bench.abilities.scenario.results import reason_of
from hil_bench.abilities.scenario.run import (
    PLAIN,
    PlayOptions,
    Run,
    RunnerDriver,
    controller_of,
    play,
    prepare,
    prepare_on,
)
from hil_bench.abilities.scenario.stage import Stage
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.errors import ConfigError, HilBenchError

# One run: a pure function of what its key is made of.

_LONGEST_PROBLEM = 2000  # characters that are kept of a firmware's last words
_CHECKED: set[tuple[Path, str]] = set()
"""The cases that this process has found as they are in the campaign: scenario and digest."""


def perform(spec: RunSpec) -> RunResult:
    """Perform a run and return its result; a controller that fails is a result too.

    A `ConfigError` says that the files here are not those of the campaign.
    """
    check_case(spec.case)
    return conclude(spec, lambda: play_spec(spec))


def conclude(spec: RunSpec, do: Callable[[], Run]) -> RunResult:
    """Do a run and return its result, also where it fails.

    Args:
        spec: the run.
        do: plays it.
    """
    try:
        run = do()
    except HilBenchError as error:
        return failed_run(spec, RunOutcome.CRASHED, str(error))
    except Exception as error:
        return failed_run(spec, RunOutcome.CRASHED, f"{type(error).__name__}: {error}")
    outcomes = {finding.judgement.outcome for finding in run.findings}
    worst = next(each for each in WORST_FIRST if each in outcomes)
    return failed_run(spec, RunOutcome(worst), run.ending)._replace(
        duration=run.duration, verdicts=verdicts_of(run)
    )


def play_spec(spec: RunSpec, options: PlayOptions = PLAIN) -> Run:
    """Play the scenario of a run; `HilBenchError` says what fails.

    Args:
        spec: the run.
        options: how to play.
    """
    return play(prepare_spec(spec), options)


def prepare_spec(spec: RunSpec) -> PreparedScenario:
    """Return the scenario of a run, with its numbers in; `HilBenchError` says what does not fit."""
    scenario = spec.case.scenario
    tolerances = tuple(sorted(spec.tolerances.items()))
    config = _load_config(scenario.bench_path, spec.case.digest, spec.seed, tolerances)
    values = parameter_values(scenario, spec.parameters)
    return prepare_on(config, scenario, values, keeps_session=True)


@lru_cache(maxsize=4)
def _load_config(
    path: Path | None, _digest: str, seed: int | None, tolerances: tuple[tuple[str, float], ...]
) -> BenchConfig:
    """Return the bench of runs that differ in their parameters; the digest is of its files."""
    return load_config(path, seed=seed, tables=nested(dict(tolerances)))


def verdicts_of(run: Run) -> tuple[Verdict, ...]:
    """Return the verdict of a run on each requirement."""
    return tuple(_verdict(each) for each in run.findings)


def failed_run(spec: RunSpec, outcome: RunOutcome, problem: str) -> RunResult:
    """Return the result of a run without verdicts.

    Args:
        spec: the run.
        outcome: what became of it.
        problem: why.
    """
    name, bench, firmware = spec.case.name, spec.case.bench, spec.case.firmware
    short = problem[-_LONGEST_PROBLEM:]
    return RunResult(spec.key, name, bench, firmware, spec.seed, spec.values, outcome, short)


def check_case(case: Case) -> None:
    """Check that the files of a case are those of the campaign.

    Raises:
        ConfigError: they are not.
    """
    scenario = case.scenario
    if (scenario.path, case.digest) in _CHECKED:
        return
    files = controller_digest(scenario.controller, scenario.path.parent)
    if case_digest(scenario, prepare(scenario).config, files) != case.digest:
        wrong = "version of hil-bench, bench or firmware is not that of the campaign"
        right = "take the same to all machines, and leave it alone while a campaign runs"
        raise ConfigError(f"{case.name}: the {wrong}; {right}")
    _CHECKED.add((scenario.path, case.digest))


def _verdict(finding: Finding) -> Verdict:
    judgement = finding.judgement
    margin = judgement.margin
    reason, seen = reason_of(judgement), judgement.coverage.share
    return Verdict(finding.requirement.id, judgement.outcome.value, margin, reason, seen)


# Snapshots: runs of a campaign that begin where they first differ from the runs before.
#
# A snapshot is a process that has played a run up to a tick and waits there. Each run that is the
# same up to then goes on in a copy of it, by `os.fork`: bench, plant and controller with all they
# hold, so the result has the same bytes as that of a run from the start.

LEAST_SHARE: Final = 0.1
"""Of a run, that a snapshot has to save."""

_CHILDREN = Path("/proc/thread-self/children")
_THREADS = Path("/proc/self/task")


class _Common(NamedTuple):
    """The part that all runs so far have in common.

    Attributes:
        run: the first of them.
        tick: the first one that is not common.
    """

    run: PreparedScenario
    tick: int


class Snapshots:
    """The snapshot of a process that does one run after the other: at most one at a time.

    A run without one to go on from is played from the start, as ever.
    """

    def __init__(self) -> None:
        self._common: _Common | None = None
        self._keeper: _Keeper | None = None

    @property
    def pid(self) -> int | None:
        """The process of the snapshot; None without one."""
        return self._keeper.pid if self._keeper is not None else None

    def perform(self, spec: RunSpec) -> RunResult:
        """Perform a run and return its result; see `running.perform`."""
        check_case(spec.case)
        result = self._keeper.go_on(spec) if self._keeper is not None else None
        if result is not None:
            return result
        try:
            prepared = prepare_spec(spec)
        except Exception as error:
            reason = error
            return conclude(spec, lambda: _fail(reason))
        self._learn(prepared)
        result = self._keeper.go_on(spec) if self._keeper is not None else None
        if result is None:
            self._give_up()
            result = conclude(spec, lambda: play(prepared))
        return result

    def close(self) -> None:
        """End the process of the snapshot."""
        if self._keeper is not None:
            self._keeper.close()
            self._keeper = None

    def _give_up(self) -> None:
        """Take no further snapshot of runs like these, where one has not come about."""
        if self._keeper is not None and self._common is not None:
            self.close()
            self._common = self._common._replace(tick=0)

    def _learn(self, prepared: PreparedScenario) -> None:
        """Take a run into account that does not go on from the snapshot; take another one."""
        self.close()
        common = self._common
        if not can_branch(prepared):
            return
        if common is None or not is_alike(common.run, prepared):
            self._common = _Common(prepared, prepared.last_tick)
            return
        tick = min(common.tick, first_difference(common.run.actions, prepared.actions))
        self._common = common._replace(tick=tick)
        if tick > LEAST_SHARE * prepared.last_tick:
            self._keeper = _Keeper(common.run, tick)


def can_branch(prepared: PreparedScenario) -> bool:
    """Return True if the process of a run can be copied: all that drives is in it, or is copied."""
    others = prepared.config.of(ControllersConfig)
    if sys.platform != "linux" or not _CHILDREN.exists() or (others and others.controllers):
        return False
    chosen = _controller(prepared)
    return chosen is None or chosen.kind.can_branch


def is_alike(one: PreparedScenario, other: PreparedScenario) -> bool:
    """Return True if two runs differ in nothing but their steps and limits, if at all."""
    return (
        one.config == other.config
        and one.last_tick == other.last_tick
        and one.scenario.path == other.scenario.path
        and _inserted(one) == _inserted(other)
        and _names(one) == _names(other)
    )


def first_difference(one: Sequence[TimedAction], other: Sequence[TimedAction]) -> int:
    """Return the tick of the first step that two runs do not have in common."""
    for mine, its in zip(one, other, strict=False):
        if mine != its:
            return min(mine.tick, its.tick)
    rest = (*one[len(other) :], *other[len(one) :])
    return rest[0].tick if rest else sys.maxsize


class _Keeper:
    """A snapshot, seen from the process that took it.

    Args:
        prepared: the run.
        tick: before which it waits.

    Attributes:
        pid: of its process.
    """

    def __init__(self, prepared: PreparedScenario, tick: int) -> None:
        self._connection, theirs = multiprocessing.Pipe()
        self.pid = os.fork()
        if self.pid == 0:
            _keep(prepared, tick, theirs)
        theirs.close()

    def go_on(self, spec: RunSpec) -> RunResult | None:
        """Return the result of a run that goes on from here; None where it cannot."""
        try:
            self._connection.send(spec)
            result: RunResult | None = self._connection.recv()
        except (EOFError, OSError):
            return None
        return result

    def close(self) -> None:
        """End it."""
        self._connection.close()
        os.waitpid(self.pid, 0)


def _keep(prepared: PreparedScenario, tick: int, connection: Connection) -> None:
    """Play a run up to a tick, and let others go on from there; never returns."""
    code = 1
    try:
        watch_nothing()
        _close_all_but(connection.fileno())
        halt = _Halt(prepared, tick, connection)
        options = PlayOptions(halt=halt.arrange)
        try:
            run = play(prepared, options)
        except Exception as error:  # a run that ends so is a result, but one of a copy only
            problem = error
            if halt.spec is not None:
                connection.send(conclude(halt.spec, lambda: _fail(problem)))
        else:
            if halt.spec is not None:
                connection.send(conclude(halt.spec, lambda: run))
        code = 0
    except _Over:
        code = 0
    finally:
        os._exit(code)  # whatever the process before it would have done at its end


def _count_threads() -> int:
    return len(list(_THREADS.iterdir()))


class _Over(BaseException):
    """The snapshot is of no more use: what it has open is closed on the way out."""


class _Halt:
    """The moment of a snapshot.

    Args:
        prepared: the run.
        tick: before which it halts.
        connection: to whom it belongs.

    Attributes:
        spec: the run that goes on in this process; None before.
    """

    def __init__(self, prepared: PreparedScenario, tick: int, connection: Connection) -> None:
        self._prepared, self._connection = prepared, connection
        self._now = (tick - 1) * prepared.config.tick_ns
        # Libraries as pyarrow start theirs anew at each fork, in a copy too.
        self._threads = _count_threads()
        self.spec: RunSpec | None = None

    def arrange(self, bench: VirtualBench, stage: Stage, driver: RunnerDriver) -> None:
        """Have a run halt."""
        desks = driver.desks
        bench.session.watch(ticks=lambda now: self._look(now, stage, desks))

    def _look(self, now: int, stage: Stage, desks: Desks | None) -> None:
        if now != self._now or self.spec is not None:
            return
        pids = desks.pids if desks is not None else set()
        has_threads = _count_threads() > self._threads
        if has_threads or {*map(int, _CHILDREN.read_text(encoding="ascii").split())} != pids:
            raise _Over  # something else has a process or a thread of its own, which no copy has
        while self.spec is None:
            try:
                spec: RunSpec = self._connection.recv()
            except EOFError:
                raise _Over from None
            self._serve(spec, stage, desks)

    def _serve(self, spec: RunSpec, stage: Stage, desks: Desks | None) -> None:
        """Let a run go on in a copy, where it can."""
        prepared = self._prepare(spec)
        if prepared is None:
            self._connection.send(None)
            return
        settle = desks.branch() if desks is not None else _ignore
        pid = os.fork()
        settle(pid == 0)
        if pid == 0:
            self.spec = spec
            stage.adopt(prepared)
        elif os.waitpid(pid, 0)[1]:
            self._connection.send(None)

    def _prepare(self, spec: RunSpec) -> PreparedScenario | None:
        with suppress(HilBenchError):
            prepared = prepare_spec(spec)
            tick = self._now // prepared.config.tick_ns + 1
            mine = self._prepared
            if (
                is_alike(mine, prepared)
                and first_difference(mine.actions, prepared.actions) >= tick
            ):
                return prepared
        return None


def _ignore(_is_copy: bool) -> None:
    pass


def _fail(error: Exception) -> NoReturn:
    raise error


def _names(prepared: PreparedScenario) -> set[str]:
    return names_in(each.condition for each in prepared.requirements)


def _controller(prepared: PreparedScenario) -> ControllerConfig | None:
    return controller_of(prepared.scenario, prepared.config, prepared.parameters)


def _inserted(prepared: PreparedScenario) -> object:
    """Return the table of a controller, and the parameters that are filled in there."""
    controller = prepared.scenario.controller
    text = repr(controller)
    values = prepared.parameters
    return controller, {name: each for name, each in values.items() if f"{{{name}}}" in text}


def _close_all_but(kept: int) -> None:
    """Close the descriptors of the process before, whose ends others wait for."""
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - numbers, not paths
        if int(name) > sys.stderr.fileno() and int(name) != kept:
            with suppress(OSError):
                os.close(int(name))


_OWN = Snapshots()


def perform_branching(spec: RunSpec) -> RunResult:
    """Perform a run, from a snapshot where there is one; for a process that does nothing else."""
    return _OWN.perform(spec)


# The runs of a campaign, in this process or in several of their own.

Backend = Callable[[Iterable[RunSpec]], Iterator[RunResult]]
"""Does runs, and yields what came of them in any order."""


def perform_here(specs: Iterable[RunSpec]) -> Iterator[RunResult]:
    """Do runs in this process, one after the other; nothing ends one that hangs.

    Yields:
        What came of each.
    """
    for spec in specs:
        yield perform(spec)


def local_backend(jobs: int) -> AbstractContextManager[Backend]:
    """Return the backend for runs on this machine.

    Args:
        jobs: processes; 0 for this one.
    """
    return run_pool(jobs) if jobs else nullcontext(perform_here)


def run_pool(jobs: int) -> "Pool[RunSpec, RunResult]":
    """Return so many processes that do runs."""
    return Pool(jobs, perform_branching, _lost_run)


def _lost_run(spec: RunSpec, end: TaskEnd, problem: str) -> RunResult:
    outcome = RunOutcome.TIMED_OUT if end is TaskEnd.TIMED_OUT else RunOutcome.CRASHED
    return failed_run(spec, outcome, problem)
