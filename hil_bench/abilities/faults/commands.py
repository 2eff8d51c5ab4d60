"""The commands that begin and end faults of a running bench."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hil_bench.abilities.faults.checks import check_ahead
from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.faults.registry import find_fault_kind
from hil_bench.bench.commands import Controls
from hil_bench.errors import ConfigError


@dataclass(frozen=True, slots=True)
class BeginFault:
    """Begin a fault, as `hil_bench.Faults.begin` does.

    Attributes:
        kind: of the fault.
        target: the node or axis that it concerns.
        arguments: further arguments of the verb, such as ``{"amount": 2e6, "duration": 0.5}``.
    """

    kind: str
    target: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def act(self, controls: Controls, now: int) -> int:
        """Begin it in this tick, or when its `at` says; return its number.

        Raises:
            ConfigError: no such kind, target or argument; it says what would be right.
        """
        find_fault_kind(self.kind)
        faults = controls.bench.part(Faults)
        faults.check_room(now)
        check_ahead(self.arguments.get("at"), now * 1e-9)
        try:
            fault = faults.begin(self.kind, self.target, **self.arguments)
        except TypeError as error:
            raise ConfigError(f"fault {self.kind} {self.target}: {error}") from None
        return faults.number_of(fault, now)


@dataclass(frozen=True, slots=True)
class ClearFault:
    """End a fault, or all.

    Attributes:
        number: the answer of its `BeginFault`; None for all faults of the bench, planned ones too.
    """

    number: int | None = None

    def act(self, controls: Controls, now: int) -> None:  # noqa: ARG002 - it ends with this tick
        """End it.

        Raises:
            ConfigError: no fault has this number.
        """
        faults = controls.bench.part(Faults)
        if self.number is None:
            faults.clear()
            faults.kept.clear()
        elif (fault := faults.kept.pop(self.number, None)) is not None:
            fault.clear()
        else:
            known = ", ".join(map(str, faults.kept)) or "no fault is there"
            raise ConfigError(f"fault {self.number}: there is no such number; there is: {known}")
