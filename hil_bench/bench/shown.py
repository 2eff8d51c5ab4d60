"""The protocol of extensions that those who watch a bench see.

Apart from `hil_bench.bench.bench`, which a wheel compiles: protocols of mypyc cannot be checked at
run time.
"""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Shown(Protocol):
    """An extension that those who watch the bench see, in keys of its own."""

    def greeting(self) -> Mapping[str, Any]:
        """Return the facts that stay, for those who begin to watch."""

    def state(self, now: int) -> Mapping[str, Any]:
        """Return its present state, at `now` [ns]."""
