"""The look of an axis on the web page: a picture whose attributes follow quantities, and plots."""

from typing import NamedTuple


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
