"""The interface between the bench and any plant, and a kind of plant, which describes it."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from hil_bench.config.settings import Key, Problems, Range, Settings
from hil_bench.units import ONE, Unit


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


class Shown(NamedTuple):
    """The format of a quantity in the status line.

    Attributes:
        template: for `str.format`, with the symbol and the unit.
        scale: what the value is multiplied by before.
    """

    template: str
    scale: float


class Quantity(NamedTuple):
    """One quantity of a plant.

    Attributes:
        name: as recordings, bindings and registers name it.
        unit: symbol of its SI unit.
        output: its place among the plant's outputs; None for the plant's command.
        is_share: whether it counts in full scales of the command, as a spool does, while the plant
            itself has it in SI.
        is_recorded: whether it is among the channels of a recording.
        tolerance: largest deviation of a simulation from a recording that counts as the same, None
            where it is not judged.
        residual: RMS by which a twin with noise-free sensors may be off, while frames come in
            time; None where no twin compares it.
        is_anchor: whether a twin must know it before it compares anything.
        shown: how the status line shows it, None where it does not.
    """

    name: str
    unit: str
    output: int | None
    is_share: bool = False
    is_recorded: bool = True
    tolerance: float | None = None
    residual: float | None = None
    is_anchor: bool = False
    shown: Shown | None = None


class Influence(NamedTuple):
    """An influence on a plant from outside, beside its command.

    Attributes:
        name: of what acts.
        unit: symbol of its SI unit.
        low: the least value [SI].
        high: the largest.
        usual: the value where nothing acts [SI]; the highest, where it varies.
    """

    name: str
    unit: str
    low: float
    high: float
    usual: float = 0.0


SUPPLY = "supply_pressure"
"""The influence by which a fault drops the supply of a hydraulic plant [Pa]."""


class Circuit(NamedTuple):
    """The hydraulics that feed an axis; the page draws valve, lines and supply from it.

    Attributes:
        pressure: to which the supply is set, where the colours of pressures end [Pa].
        swept_a: volume that port A takes for 1 SI unit of the quantity `speed` [m³/m or m³/rad].
        swept_b: volume that port B gives for it.
        pump: `fixed`, `constant-pressure` or `load-sensing`; empty where the pressure is constant.
        relief: pressure at which the relief valve opens [Pa]; 0 without one.
        accumulator: its gas volume [m³]; 0 without one.
        has_filter: whether the unit has a filter.
        counterbalance: ports with a counterbalance valve: empty, `a`, `b` or `ab`.
        hoses: ports with a line that has a length: empty, `a`, `b` or `ab`.
    """

    pressure: float
    swept_a: float = 0.0
    swept_b: float = 0.0
    pump: str = ""
    relief: float = 0.0
    accumulator: float = 0.0
    has_filter: bool = False
    counterbalance: str = ""
    hoses: str = ""


class Page(NamedTuple):
    """The look of a plant or a device on the web page.

    Attributes:
        svg: an SVG element with a viewBox and attributes bound to quantities (docs/plugins.md);
            empty for a table of the quantities.
        plots: names of the quantities that are plotted at first; empty for all of them.
        circuit: the hydraulics around it; None without any.
    """

    svg: str = ""
    plots: tuple[str, ...] = ()
    circuit: Circuit | None = None


# A kind of plant: one object describes it completely to the bench.


_NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})


class Fact(NamedTuple):
    """One number that an engineer checks of an axis.

    Attributes:
        name: of the number.
        value: in `unit`.
        unit: as data sheets have it.
        note: what else is to be said; empty for nothing.
    """

    name: str
    value: float
    unit: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """One axis: a plant, and what its devices must know of it.

    Attributes:
        name: the axis, as in ``[plant.NAME]``.
        kind: of its plant.
    """

    name: str
    kind: "PlantKind[Any]"

    @property
    def full_scale(self) -> float:
        """The command of 100 %, where no device of the axis has another one [SI]."""
        return 1.0

    @property
    def influences(self) -> tuple[Influence, ...]:
        """The influences on its plant from outside."""
        return ()

    @property
    def defects(self) -> tuple[Influence, ...]:
        """The defects of its plant, as amounts that are 0 where it is sound."""
        return ()

    def limits(self, quantity: str) -> tuple[float, float]:
        """Return the least and the largest value of a quantity [SI]."""
        return -math.inf, math.inf


AxisT = TypeVar("AxisT", bound=AxisConfig)


class PlantKind(ABC, Generic[AxisT]):
    """A kind of plant.

    Attributes:
        name: as in ``kind = "NAME"`` of ``[plant.AXIS]``.
        keys: of that table.
        quantities: what can be seen of it and its one command, in the order of a recording.
        command_unit: the unit of `full_scale`.
        usual_results: what machines reach, by the name of a `Fact`; beyond it a result is doubted.
        default_nodes: the nodes of a file without any.
    """

    name: str
    keys: tuple[Key, ...] = ()
    quantities: tuple[Quantity, ...]
    command_unit: Unit = ONE
    usual_results: Mapping[str, Range] = _NOTHING
    default_nodes: Mapping[str, Mapping[str, object]] = _NOTHING

    @abstractmethod
    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> AxisT | None:
        """Return the record of an axis; what makes no sense is noted, and None returned for it.

        Args:
            name: of the axis.
            settings: of its table, each right by itself.
            step_us: step of the bench's plants [us].
            problems: where problems are noted.
        """

    @abstractmethod
    def build(self, axis: AxisT, dt: float, start: Mapping[str, float] | None = None) -> Plant:
        """Return the plant of an axis, ready to step.

        Args:
            axis: its record.
            dt: step [s].
            start: quantities to begin with [SI], as a recording has them; what is missing, and
                without it all, is as configured.
        """

    def group(self, plants: Sequence[Plant]) -> PlantGroup | None:
        """Return the group that moves several plants of this kind at once; None for no group.

        Args:
            plants: that `build` has returned, two or more, in the order of their axes. They stay
                plants: whoever has one of them may read, influence and restart it.
        """
        return None

    def derive(self, settings: Settings, problems: Problems) -> Settings:
        """Return settings with the values that follow from others, such as those of a data sheet.

        Args:
            settings: of an axis, one for each key.
            problems: where problems are noted.
        """
        return settings

    def specialise(
        self, settings: Settings, folder: Path, problems: Problems
    ) -> "PlantKind[AxisT] | None":
        """Return the kind of one axis, where its quantities are what a file says.

        What is wrong is noted, and None returned.

        Args:
            settings: of the axis, one for each key.
            folder: that relative paths of the settings start from.
            problems: where problems are noted.
        """
        return self

    def supply_of(self, settings: Settings) -> str:
        """Return the name of the ``[supply.NAME]`` that an axis shares; empty for none."""
        return ""

    def find_leftovers(self, settings: Settings) -> Iterator[tuple[str, str]]:
        """Yield the keys of an axis whose defaults fit badly to the rest, and why."""
        yield from ()

    def summarise(self, axis: AxisT, tick_us: int, step_us: int) -> Sequence[Fact]:
        """Return the key figures of an axis that an engineer checks first."""
        return ()

    def full_scale(self, settings: Settings) -> float:
        """Return the command of 100 % of an axis with these settings, in `command_unit`."""
        return 1.0

    def lowest_supply_bar(self, settings: Settings) -> float | None:
        """Return the least pressure at which the supply can be held [bar]; None without one."""
        return None

    def find_doubts(self, axis: AxisT, tick_us: int, step_us: int) -> Iterator[str]:
        """Yield motions of an axis that the bench's tick or step does not resolve."""
        yield from ()

    def page(self, axis: AxisT) -> Page | None:
        """Return the look of an axis on the web page; None for a table and plots of all."""
        return None

    @property
    def start_with(self) -> str:
        """The quantity that a recording must have, for a plant to begin where it does."""
        return self.quantities[0].name

    @cached_property
    def usual(self) -> Mapping[str, Range]:
        """The ranges that data sheets and machines have, by key; beyond it a value is doubted."""
        return {key.name: key.usual for key in self.keys if key.usual is not None}

    @cached_property
    def possible(self) -> Mapping[str, Range]:
        """The ranges that nature allows, by key; beyond it a value is refused."""
        return {key.name: key.possible for key in self.keys if key.possible is not None}

    @cached_property
    def by_name(self) -> Mapping[str, Quantity]:
        """The quantities by their names."""
        return {quantity.name: quantity for quantity in self.quantities}

    @cached_property
    def command(self) -> Quantity:
        """The quantity that a device may command."""
        return next(quantity for quantity in self.quantities if quantity.output is None)

    @property
    def takes_valve(self) -> bool:
        """Return True if a valve may command it: by a ratio, or by a length as that of a spool."""
        return self.command.unit in {"-", "m"}

    @cached_property
    def outputs(self) -> Sequence[Quantity]:
        """The quantities that a device may show."""
        return tuple(quantity for quantity in self.quantities if quantity.output is not None)

    def outputs_in(self, unit: str) -> Sequence[Quantity]:
        """Return the quantities of an SI unit that a device may show."""
        return tuple(quantity for quantity in self.outputs if quantity.unit == unit)

    @cached_property
    def follower(self) -> Quantity:
        """The output that follows the command: it is in the command's unit."""
        return self.outputs_in(self.command.unit)[0]


class AxisSettings(NamedTuple):
    """An axis whose keys are right by themselves.

    Attributes:
        kind: of its plant.
        settings: the values of its keys.
    """

    kind: PlantKind[Any]
    settings: Settings
