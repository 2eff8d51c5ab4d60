"""The interface between the bench and any plant."""

from collections.abc import Mapping, Sequence
from typing import Protocol


class Influenced(Protocol):
    """A thing that accepts influences from outside."""

    def influence(self, name: str, value: float | None) -> None:
        """Set what acts on it from outside [SI]; None lets it be what it was.

        Asked for the influences and defects alone that the axis' configuration names.
        """


class Plant(Influenced, Protocol):
    """One plant with one command; its kind says which quantity each output is."""

    @property
    def output(self) -> Sequence[float]:
        """The present outputs in SI, in the order that the kind's quantities name."""

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on by `steps` steps under a constant command [SI]; return the outputs."""

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values of some quantities [SI], as far as they are plausible."""


class PlantGroup(Protocol):
    """Several plants that are moved on at once, each as `Plant.drive` would."""

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move the plants on by `steps` steps, each under its command [SI].

        Args:
            commands: of each plant, constant over the steps.
            steps: how many.

        Returns:
            The outputs of each plant, as `Plant.drive` returns them.
        """
