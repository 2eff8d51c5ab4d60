"""An axis: a plant with its devices, and the paths of its signals."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple, Protocol

from hil_bench.plants.plant import Influence, Plant, Quantity

# The path of a signal through stages that come and go.


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


# One axis of the bench: what commands it, its plant, and what measures it.
#
# A kind of device says by a `Fitting` what its device does: it commands axes by `Drive`s, measures
# them by `Measurement`s, acts in each tick, and offers numbers to other buses.


class Enabled(Protocol):
    """A valve with an enable input.

    Attributes:
        enable_input: whether the input is on.
    """

    enable_input: bool


class Rate(NamedTuple):
    """The rate of change that a sensor shows beside its quantity.

    Attributes:
        name: as in ``NODE.measured_NAME`` of a recording.
        quantity: of the plant.
        stages: what it passes on its way, after the quantity.
    """

    name: str
    quantity: Quantity
    stages: Iterable[Stage] = ()


class Measurement:
    """The measurement of a quantity, and of its rate where there is one, for a device or object.

    Args:
        publish: takes quantity, then rate if any, and the time of the tick [ns].
        quantity: which of the plant's.
        stages: what the quantity passes on its way; without any the sensor is ideal.
        name: of the sensor, for recordings and faults.
        rate: what else it shows.
        full: of a quantity that counts in full scales, the full scale [SI].

    Attributes:
        name: as passed in.
        path: the way of the quantity.
        rate_path: the way of the rate, None without one.
        measured: what was published last [SI]; of a share, before the division by `full`.
        measured_rate: the rate that was published last.
        has_power: False: the device is off and publishes nothing; what is measured is NaN.
        full: as passed in.
        channels: what is recorded: name and unit of `measured` / `full` and `measured_rate`.
    """

    def __init__(
        self,
        publish: Callable[..., None],
        quantity: Quantity,
        stages: Iterable[Stage] = (),
        *,
        name: str = "",
        rate: Rate | None = None,
        full: float = 1.0,
    ) -> None:
        self.name = name
        self.path = SignalPath(stages)
        self.rate_path = None if rate is None else SignalPath(rate.stages)
        self.measured = self.measured_rate = math.nan
        self.has_power = True
        self.channels = [(f"{name}.measured", quantity.unit)]
        self._publish = publish
        self._place = quantity.output or 0
        self._rate_place = 0
        self.full = full
        if rate is not None:
            self._rate_place = rate.quantity.output or 0
            self.channels.append((f"{name}.measured_{rate.name}", rate.quantity.unit))

    def take(self, output: Sequence[float], now: int) -> None:
        """Publish what the plant shows in this tick [ns]."""
        value = output[self._place]
        for stage in self.path.stages:
            value = stage(value)
        self.measured = value
        if self.rate_path is None:
            if self.has_power:
                self._publish(value, now)
            else:
                self.measured = math.nan
            return
        rate = output[self._rate_place]
        for stage in self.rate_path.stages:
            rate = stage(rate)
        self.measured_rate = rate
        if self.has_power:
            self._publish(value, rate, now)
        else:
            self.measured = self.measured_rate = math.nan


class CommandSource(Protocol):
    """The source of an axis's commands, such as a valve for its spool."""

    @property
    def full_opening(self) -> float:
        """The command of 100 %, of a spool the position [m]."""

    def command(self, now: int) -> float:
        """Return the command at `now` [ns], in SI."""

    def publish(self, answer: float, now: int) -> None:
        """Take what follows the command, such as the spool position, at `now` [ns]."""


class Drive(NamedTuple):
    """A device, or an object of one, that commands an axis.

    Attributes:
        name: for faults.
        axis: which it commands.
        device: gives the command.
        enable: its enable input, None where it has none.
    """

    name: str
    axis: str
    device: CommandSource
    enable: Enabled | None = None


class RegisterValue(NamedTuple):
    """A quantity of a device for a bus other than CANopen, to read and write, in SI.

    Attributes:
        unit: symbol of its SI unit, ``-`` for a number, a truth value or an object.
        read: returns its present value; NaN where there is none.
        write: sets it at a bench time [ns], or raises `SdoAbort`; None where nobody may.
    """

    unit: str
    read: Callable[[], float]
    write: Callable[[float, int], None] | None = None


def _no_registers() -> Mapping[str, RegisterValue]:
    return {}


@dataclass(frozen=True, slots=True)
class Fitting:
    """The functions of one device on the bench, beside the CANopen services of its node.

    Attributes:
        drives: by which it commands axes.
        sensors: by which it measures, each with the name of its axis; None for what the device
            measures itself and hands on in `advance`.
        sources: the objects that are bound to quantities, in the same way.
        advance: called in each tick [ns], after the axes; None where it has nothing to do.
        registers: returns the numbers that another bus may read and write, by name.
        state: returns the state of the device in a word; None where it has none.
    """

    drives: tuple[Drive, ...] = ()
    sensors: tuple[tuple[str | None, Measurement], ...] = ()
    sources: tuple[tuple[str, Measurement], ...] = ()
    advance: Callable[[int], None] | None = None
    registers: Callable[[], Mapping[str, RegisterValue]] = _no_registers
    state: Callable[[], str] | None = None


@dataclass(frozen=True, slots=True)
class Axis:
    """One plant with what commands it and what measures it.

    Attributes:
        name: as in the configuration.
        plant: what moves.
        valve: the device that commands it.
        sensors: what is given the plant's outputs.
        quantities: of the plant.
        influences: what may act on the plant from outside.
        follower: place of the output that follows the command.
        defects: what may be worn or broken at the plant.
        command_path: what the command passes between device and plant.
        recorded: the quantities of `row`.
    """

    name: str
    plant: Plant
    valve: CommandSource
    sensors: tuple[Measurement, ...]
    quantities: tuple[Quantity, ...]
    influences: tuple[Influence, ...]
    follower: int
    defects: tuple[Influence, ...] = ()
    command_path: SignalPath = field(default_factory=SignalPath)
    recorded: tuple[Quantity, ...] = field(init=False, repr=False)
    _pick: Callable[[Sequence[float]], tuple[float, ...]] = field(init=False, repr=False)
    _shares: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        recorded = tuple(quantity for quantity in self.quantities if quantity.is_recorded)
        object.__setattr__(self, "recorded", recorded)
        # The command stands behind the outputs.
        places = tuple(-1 if quantity.output is None else quantity.output for quantity in recorded)
        object.__setattr__(self, "_pick", _picker(places))
        shares = tuple(place for place, quantity in enumerate(recorded) if quantity.is_share)
        object.__setattr__(self, "_shares", shares)

    def row(self, commanded: float) -> list[float]:
        """Return the present values of the recorded quantities.

        Args:
            commanded: what the valve has commanded last [SI].
        """
        row = list(self._pick([*self.plant.output, commanded]))
        full = self.valve.full_opening
        for place in self._shares:
            row[place] /= full
        return row

    def command(self, now: int) -> tuple[float, float]:
        """Return the command of the valve at `now` [ns] and the one that the plant gets [SI]."""
        commanded = u = self.valve.command(now)
        for stage in self.command_path.stages:
            u = stage(u)
        return commanded, u

    def publish(self, output: Sequence[float], now: int) -> None:
        """Give the valve and the sensors what the plant shows at `now` [ns]."""
        self.valve.publish(output[self.follower], now)
        for sensor in self.sensors:
            sensor.take(output, now)


def _picker(places: tuple[int, ...]) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """Return a callable that picks the values at these places."""
    if len(places) > 1:
        return itemgetter(*places)
    return lambda values: tuple(values[place] for place in places)
