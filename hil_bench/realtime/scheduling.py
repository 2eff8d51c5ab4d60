"""What the process does for the time of a paced run so that the loop is not held up."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def undisturbed_by_garbage_collection() -> Iterator[None]:
    """Keep the cyclic garbage collector out of a paced run.

    What exists at the start is collected once and then set aside; until the end nothing is
    searched. Reference counting still frees what the ticks use, as long as they build no cycles.
    The collector is left as it was found, after an exception too.
    """
    was_enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_enabled:
            gc.enable()
