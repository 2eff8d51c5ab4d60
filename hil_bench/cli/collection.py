"""Garbage collection, put off while a verb is imported and its bench is built."""

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def collection_put_off() -> Iterator[None]:
    """Collect nothing within the block.

    What is made there stays for the whole run, so looking through it again and again is in vain; it
    is a seventh of a start.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
