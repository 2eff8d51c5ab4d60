"""Arguments that `campaign` and `falsify` share."""

import argparse
import os


def add_jobs_argument(parser: argparse.ArgumentParser) -> None:
    """Add --jobs."""
    parser.add_argument(
        "--jobs",
        type=_jobs,
        metavar="N",
        default=_processors(),
        help="number of processes (default: %(default)s); 0 runs in this one, without time-outs",
    )


def count(text: str) -> int:
    """Return a positive integer.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give an integer from 1 up")
    return int(text)


def _jobs(text: str) -> int:
    return 0 if text == "0" else count(text)


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
