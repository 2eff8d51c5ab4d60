"""The path of a signal through stages that come and go."""

from collections.abc import Callable, Iterable

Stage = Callable[[float], float]
"""A part of the way: takes the signal, returns what it makes of it."""


class SignalPath:
    """The stages of one signal, in their order.

    Attributes:
        stages: each is given what the one before it returned.
    """

    __slots__ = ("stages",)

    def __init__(self, stages: Iterable[Stage] = ()) -> None:
        self.stages = tuple(stages)

    def add(self, stage: Stage) -> None:
        """Put a stage at the end."""
        self.stages = (*self.stages, stage)

    def remove(self, stage: Stage) -> None:
        """Take a stage out, if it is there."""
        self.stages = tuple(present for present in self.stages if present != stage)
