"""A kind of plant: one object describes it completely to the bench."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Generic, NamedTuple, TypeVar

from hil_bench.config.settings import Key, Problems, Range, Settings
from hil_bench.plants.plant import Influence, Page, Plant, PlantGroup, Quantity
from hil_bench.units import ONE, Unit

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
