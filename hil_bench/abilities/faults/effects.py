"""The effects of faults on the parts of a bench."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

from hil_bench.abilities.faults.stages import Growth, SensorStage
from hil_bench.devices.axis import SignalPath, Stage
from hil_bench.plants.plant import Influenced
from hil_bench.plants.quantity import Influence

Act = Callable[[int], None]
"""Does something in a tick, at its time [ns]."""

T = TypeVar("T")


class SensorPoint(NamedTuple):
    """The point at which a fault acts on a sensor.

    Attributes:
        value: the way of what it measures.
        rate: the way of its rate of change, None where it shows none.
    """

    value: SignalPath
    rate: SignalPath | None = None


class SpoolPoint(NamedTuple):
    """The point at which a fault acts on a valve.

    Attributes:
        command: the way of the spool's set-point [m].
        position: returns where the spool is [m].
        full: spool position of 100 % [m].
    """

    command: SignalPath
    position: Callable[[], float]
    full: float = 1.0


class SupplyPoint(NamedTuple):
    """The point at which a fault acts on the supply of an axis, or on one that axes share.

    Attributes:
        plant: of the axis; the supply that is shared.
        lowest: the least pressure at which the supply can be held [Pa].
    """

    plant: Influenced
    lowest: float


class DefectPoint(NamedTuple):
    """The point at which a fault acts on the plant of an axis, or on a supply that axes share.

    Attributes:
        plant: of the axis; the supply that is shared.
        known: what may be worn or broken, by name.
        amounts: by the name of a defect, what each fault adds to it now; the plant has the sum.
    """

    plant: Influenced
    known: Mapping[str, Influence]
    amounts: dict[str, dict[object, float]]

    def add(self, name: str, owner: object, amount: float) -> None:
        """Let a fault add an amount to a defect."""
        self.amounts.setdefault(name, {})[owner] = amount
        self._set(name)

    def remove(self, name: str, owner: object) -> None:
        """Let a fault add no more."""
        self.amounts.get(name, {}).pop(owner, None)
        self._set(name)

    def _set(self, name: str) -> None:
        total = sum(self.amounts[name].values())
        self.plant.influence(name, min(total, self.known[name].high))


class SensorEffect:
    """A stage behind everything else that a sensor's signal passes."""

    def __init__(self, point: SensorPoint, make: Callable[[], SensorStage]) -> None:
        self._point, self._make = point, make
        self._stage: SensorStage | None = None

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Put the stage in."""
        self._stage = self._make()
        self._point.value.add(self._stage.value)
        if self._point.rate is not None:
            self._point.rate.add(self._stage.rate)

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Take the stage out."""
        if self._stage is not None:
            self._point.value.remove(self._stage.value)
            if self._point.rate is not None:
                self._point.rate.remove(self._stage.rate)


class SpoolEffect:
    """A stage between a valve's electronics and its spool.

    Args:
        point: the valve.
        make: makes the stage from the spool's position [m] at that time.
    """

    def __init__(self, point: SpoolPoint, make: Callable[[float], Stage]) -> None:
        self._point, self._make = point, make
        self._stage: Stage | None = None

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Put the stage in."""
        self._stage = self._make(self._point.position())
        self._point.command.add(self._stage)

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Take the stage out."""
        if self._stage is not None:
            self._point.command.remove(self._stage)


class DefectEffect:
    """A defect of a plant, which grows.

    Args:
        point: the plant.
        name: of the defect.
        make: makes its growth.
        holds: what is called before each tick of the plants.
    """

    def __init__(
        self,
        point: DefectPoint,
        name: str,
        make: Callable[[], Growth],
        holds: list[Act],
    ) -> None:
        self._point, self._name, self._make, self._holds = point, name, make, holds
        self._growth = make()

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Let it grow."""
        self._growth = self._make()
        self._holds.append(self._grow)

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Mend it."""
        self._holds.remove(self._grow)
        self._point.remove(self._name, self)

    def _grow(self, _now: int) -> None:
        if not self._growth.is_full:
            self._point.add(self._name, self, self._growth.next())


class Acts(NamedTuple):
    """The effect of two callables, each called with a time [ns]."""

    begin: Act
    end: Act


def listed(items: list[T], item: T) -> Acts:
    """Return the effect that an item is in a list."""
    return Acts(lambda _now: items.append(item), lambda _now: items.remove(item))
