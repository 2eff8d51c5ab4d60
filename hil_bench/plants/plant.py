"""The interface between the bench and any plant: what moves, its quantities, and its look."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol


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
