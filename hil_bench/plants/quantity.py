"""The quantities of a plant: declared once, asked by everybody who shows, binds or judges them."""

from typing import NamedTuple


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
