"""A fault: when it is there, and how to end it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, Self


class Effect(Protocol):
    """The effect of a fault."""

    def begin(self, now: int, /) -> None:
        """Make it so, at `now` [ns]."""

    def end(self, now: int, /) -> None:
        """Take it back, at `now` [ns]."""


Clear = Callable[["Fault"], None]
"""Ends a fault."""


class Fault:
    """One fault of one target.

    It lasts until it is cleared or its duration is over, and at least one tick. As a context
    manager it is cleared at the end of the block.

    Attributes:
        kind: what goes wrong.
        target: with what: the name of a node or an axis.
        begins: bench time [ns]; None for the next tick.
        duration: how long it lasts [ns]; None until it is cleared.
        effect: what it does.
        is_active: whether it is there now.
    """

    def __init__(
        self,
        kind: str,
        target: str,
        effect: Effect,
        *,
        begins: int | None,
        duration: int | None,
        clear: Clear,
    ) -> None:
        self.kind = kind
        self.target = target
        self.begins = begins
        self.duration = duration
        self.effect = effect
        self.is_active = False
        self._clear = clear

    @property
    def ends(self) -> int | None:
        """When it ends by itself, in bench time [ns]; None where it does not, or has not begun."""
        if self.begins is None or self.duration is None:
            return None
        return self.begins + self.duration

    def clear(self) -> None:
        """End the fault, or see to it that it never begins; a second call does nothing."""
        self._clear(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def __repr__(self) -> str:
        """Return kind, target and state."""
        state = "active" if self.is_active else "not active"
        return f"<Fault {self.kind} {self.target}, {state}>"


@dataclass(frozen=True, slots=True)
class FaultConfig:
    """A fault that happens by itself.

    Attributes:
        kind: its name.
        target: with what.
        at: when, in bench time [s].
        duration: for how long [s]; None for ever.
        values: what the kind needs to know, by parameter of its verb, in SI.
    """

    kind: str
    target: str
    at: float
    duration: float | None
    values: Mapping[str, float | int | str]
