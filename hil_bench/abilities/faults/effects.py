"""The effects of faults on the parts of a bench, and the stages that they put into signals."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

from hil_bench.abilities.faults.checks import BrokenReading
from hil_bench.devices.axis import SignalPath, Stage
from hil_bench.devices.measurement.low_pass import Draw, FirstOrderLowPass
from hil_bench.plants.plant import Influence, Influenced

Act = Callable[[int], None]
"""Does something in a tick, at its time [ns]."""

T = TypeVar("T")


# Stages of signals: of sensors, with their rate of change, and of spools.


class SensorStage(Protocol):
    """One fault of one sensor."""

    def value(self, value: float) -> float:
        """Return the measured value in place of `value`; called once a tick."""

    def rate(self, rate: float) -> float:
        """Return the measured rate of change in place of `rate`; called after `value`."""


class Frozen:
    """The first value stays, and does not change."""

    def __init__(self) -> None:
        self._value: float | None = None

    def value(self, value: float) -> float:
        """Return the first value."""
        if self._value is None:
            self._value = value
        return self._value

    def rate(self, rate: float) -> float:  # noqa: ARG002 - what stands has no speed
        """Return 0."""
        return 0.0


class Shifted:
    """The value is off by an amount that grows.

    Args:
        offset: at the first tick.
        slope: growth [1/s].
        tick: time between two calls [s].
    """

    def __init__(self, offset: float, slope: float, tick: float) -> None:
        self._offset, self._slope, self._tick = offset, slope, tick
        self._calls = 0

    def value(self, value: float) -> float:
        """Return the value and the present amount."""
        offset = self._offset + self._slope * self._calls * self._tick
        self._calls += 1
        return value + offset

    def rate(self, rate: float) -> float:
        """Return the rate and that of the amount."""
        return rate + self._slope


class Noisy:
    """Noise is added to the value; its rate stays."""

    def __init__(self, rms: float, draw: Draw) -> None:
        self._rms, self._draw = rms, draw

    def value(self, value: float) -> float:
        """Return the value with noise."""
        return value + self._rms * self._draw()

    def rate(self, rate: float) -> float:
        """Return the rate."""
        return rate


class Broken:
    """Nothing is measured any more: there is no value, or one beyond every range."""

    def __init__(self, reading: BrokenReading) -> None:
        readings = {
            BrokenReading.NOTHING: math.nan,
            BrokenReading.LOW: -math.inf,
            BrokenReading.HIGH: math.inf,
        }
        self._reading = readings[reading]

    def value(self, value: float) -> float:  # noqa: ARG002 - the wire is broken
        """Return NaN, or an infinity."""
        return self._reading

    def rate(self, rate: float) -> float:  # noqa: ARG002 - the wire is broken
        """Return NaN."""
        return math.nan


class Lag:
    """A first-order lag, which leaves out what is no number.

    Args:
        time_constant: of the lag [s].
        tick: time between two calls [s].
        start: where it begins; without it, settled at the first value.
    """

    def __init__(self, time_constant: float, tick: float, start: float | None = None) -> None:
        self._low_pass = FirstOrderLowPass(1.0 / (2.0 * math.pi * time_constant), tick)
        self._tick = tick
        self._is_settled = start is not None
        self._low_pass.settle(start or 0.0)

    def follow(self, value: float) -> float:
        """Return the value behind the low-pass."""
        if not math.isfinite(value):
            return value
        if not self._is_settled:
            self._low_pass.settle(value)
            self._is_settled = True
        self._low_pass.advance(value)
        return self._low_pass.at(self._tick)


class Slowed:
    """Value and rate come late, by a first-order lag."""

    def __init__(self, time_constant: float, tick: float) -> None:
        self.value = Lag(time_constant, tick).follow
        self.rate = Lag(time_constant, tick).follow


class Growth:
    """An amount that grows from tick to tick.

    Args:
        full: what it comes to.
        ticks: how long that takes; 0 for at once.
    """

    def __init__(self, full: float, ticks: int) -> None:
        self._full, self._ticks = full, ticks
        self._passed = 0

    @property
    def is_full(self) -> bool:
        """True if it has grown to its full size."""
        return self._passed > self._ticks

    def next(self) -> float:
        """Return the amount of the next tick."""
        share = 1.0 if self._passed >= self._ticks else self._passed / self._ticks
        self._passed += 1
        return self._full * share


class Bound:
    """A silted spool: it moves once its set-point is off by a band, and then all the way.

    Args:
        band: how far the set-point must be off [m], which grows.
        position: where the spool is at first [m].
    """

    def __init__(self, band: Growth, position: float) -> None:
        self._band, self._position = band, position

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        if abs(setpoint - self._position) > self._band.next():
            self._position = setpoint
        return self._position


class Weak:
    """Solenoids without their full force: the spool goes no further than a share of its stroke.

    Args:
        loss: share of the stroke that is lost, which grows.
        full: spool position of 100 % [m].
    """

    def __init__(self, loss: Growth, full: float) -> None:
        self._loss, self._full = loss, full

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        reach = self._full * (1.0 - self._loss.next())
        return min(max(setpoint, -reach), reach)


# Points of a bench, and effects there.


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
