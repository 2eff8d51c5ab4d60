"""A bar for long work."""

from collections.abc import Iterator
from contextlib import contextmanager

from hil_bench.campaign.executing import Note
from hil_bench.campaign.records import RunResult


@contextmanager
def progress_bar(total: int, *, is_shown: bool | None) -> Iterator[Note]:
    """Show how many runs are done, and how many of them failed.

    Args:
        total: runs to be done.
        is_shown: None for: on a terminal only.

    Yields:
        What is to be told of each result, and by None of a run that was done before.
    """
    from tqdm import tqdm  # noqa: PLC0415 - an extra

    failures = 0
    with tqdm(total=total, unit=" runs", disable=None if is_shown is None else not is_shown) as bar:

        def note(result: RunResult | None) -> None:
            nonlocal failures
            if result is not None and result.outcome.is_failure:
                failures += 1
                bar.set_postfix_str(f"{failures} failed", refresh=False)
            bar.update()

        yield note
