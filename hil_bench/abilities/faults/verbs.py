"""The verbs of faults: one for each kind, looked up when it is used.

`verbs.pyi` beside it has their signatures for type checkers; `tests/support/fault_verbs.py` writes
it from the kinds.
"""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, Generic, TypeVar

from hil_bench.abilities.faults.registry import FAULT_KINDS

F = TypeVar("F")


class Verbs(Generic[F]):
    """The verbs of something with a method ``begin(kind, target, **values)``.

    ``faults.offset("pressure_a", 20e5)`` is ``faults.begin("offset", "pressure_a", amount=20e5)``.
    """

    begin: Callable[..., F]

    def __getattr__(self, name: str) -> Callable[..., F]:
        """Return the verb of a kind of fault.

        Raises:
            AttributeError: there is no such kind.
        """
        kind = None if name.startswith("_") else FAULT_KINDS.find(name)
        if kind is None:
            known = ", ".join(FAULT_KINDS.names())
            raise AttributeError(f"no fault is called {name}; there are {known}")
        signature = inspect.signature(kind.make)
        first = next(iter(signature.parameters))

        @wraps(kind.make)
        def verb(*values: Any, **named: Any) -> F:  # noqa: ANN401 - of the kind
            named |= signature.bind_partial(*values).arguments
            target = [named.pop(first)] if first in named else []
            return self.begin(name, *target, **named)

        return verb

    def __dir__(self) -> list[str]:
        """Return the verbs too."""
        return [*super().__dir__(), *FAULT_KINDS.names()]
