"""The effects of faults on the parts of a bench."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

from hil_bench.abilities.faults.stages import Growth, SensorStage
from hil_bench.devices.axis import SignalPath, Stage
from hil_bench.plants.plant import Influence, Influenced

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
        held: the pressures at which the supply can be held, and its usual one [Pa].
    """

    plant: Influenced
    held: Influence


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


class _Watched:
    """Stages in the ways of signals, which notices whether they change anything.

    Attributes:
        has_acted: whether a value behind a stage was another one than before it.
    """

    def __init__(self) -> None:
        self.has_acted = False
        self._stages: list[tuple[SignalPath, Stage]] = []

    def _put(self, path: SignalPath, stage: Stage) -> None:
        def pass_on(value: float) -> float:
            found = stage(value)
            self.has_acted |= found != value and not (math.isnan(found) and math.isnan(value))
            return found

        path.add(pass_on)
        self._stages.append((path, pass_on))

    def end(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Take the stages out."""
        for path, stage in self._stages:
            path.remove(stage)
        self._stages.clear()


class SensorEffect(_Watched):
    """A stage behind everything else that a sensor's signal passes."""

    def __init__(self, point: SensorPoint, make: Callable[[], SensorStage]) -> None:
        super().__init__()
        self._point, self._make = point, make

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Put the stage in."""
        stage = self._make()
        self._put(self._point.value, stage.value)
        if self._point.rate is not None:
            self._put(self._point.rate, stage.rate)


class SpoolEffect(_Watched):
    """A stage between a valve's electronics and its spool.

    Args:
        point: the valve.
        make: makes the stage from the spool's position [m] at that time.
    """

    def __init__(self, point: SpoolPoint, make: Callable[[float], Stage]) -> None:
        super().__init__()
        self._point, self._make = point, make

    def begin(self, now: int) -> None:  # noqa: ARG002 - of the protocol
        """Put the stage in."""
        self._put(self._point.command, self._make(self._point.position()))


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
        self.has_acted = False

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
            amount = self._growth.next()
            self.has_acted |= amount != 0.0
            self._point.add(self._name, self, amount)


class Acts(NamedTuple):
    """The effect of two callables, each called with a time [ns].

    Attributes:
        begin: makes it so.
        end: takes it back.
        item: has `has_acted` where it may be in vain.
    """

    begin: Act
    end: Act
    item: Any = None  # of `object` mypyc makes a class that it cannot import

    @property
    def has_acted(self) -> bool:
        """Return True if it has changed something."""
        return getattr(self.item, "has_acted", True)


def listed(items: list[T], item: T) -> Acts:
    """Return the effect that an item is in a list."""
    return Acts(lambda _now: items.append(item), lambda _now: items.remove(item), item)
