"""Arguments that `campaign` and `falsify` share, and their runs as they are counted."""

import argparse
import math
import os

from hil_bench.abilities.campaign.executing import Note
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.cli.progress import Work


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


def count(text: str) -> int:
    """Return a positive integer.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 1 up")
    return int(text)


def count_from_zero(text: str) -> int:
    """Return an integer that is not negative.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 0 up")
    return int(text)


def positive(text: str) -> float:
    """Return a positive number.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a positive number")
    return number


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
