"""Arguments that `campaign` and `falsify` share, and their runs as they are counted."""

import argparse
import os

from hil_bench.abilities.campaign.executing import Note
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.cli.parser import count_from_zero
from hil_bench.cli.status_line import Work


def add_jobs_argument(parser: argparse.ArgumentParser) -> None:
    """Add --jobs."""
    parser.add_argument(
        "--jobs",
        type=count_from_zero,
        metavar="N",
        default=_processors(),
        help="number of processes (default: %(default)s); 0 runs in this one, without time-outs",
    )


def count_runs(work: Work) -> Note:
    """Return a function that counts the runs of a campaign or a search, and those that fail."""
    failures = 0

    def note(result: RunResult | None) -> None:
        nonlocal failures
        work.done += 1
        if result is not None and result.outcome.is_failure:
            failures += 1
            work.remark = f"{failures} failed"

    return note


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
