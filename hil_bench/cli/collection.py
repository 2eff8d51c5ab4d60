"""Garbage collection, put off while a verb is imported and its bench is built."""

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def collection_put_off(*, freezes: bool = False) -> Iterator[None]:
    """Collect nothing within the block.

    What is made there stays for the whole run, so looking through it again and again is in vain; it
    is a seventh of a start.

    Args:
        freezes: whether no later collection looks through it either, nor that at the end of the
            process; for a process that is the verb's own.

    Yields:
        Nothing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if freezes:
            gc.freeze()
        if was_enabled:
            gc.enable()
