"""The runs of a campaign, in this process or in several of their own."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext

from hil_bench.abilities.campaign.records import RunOutcome, RunResult, RunSpec
from hil_bench.abilities.campaign.running import failed_run, perform
from hil_bench.abilities.campaign.snapshot import perform_branching
from hil_bench.session.pool import Pool, TaskEnd

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
