"""Extensions of the paper's constants: air in the oil, bristles, a real supply."""

import math
from dataclasses import dataclass, replace
from types import NoneType
from typing import Final

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    ROWS,
    require_fields,
    require_finite,
    require_kind,
    require_positive,
)

# The filter of a supply unit, between its pump with the relief valve and the line to the valves.
#
#     D(Q) = min(R Q, P_by),   R = dp_N / Q_N nu / nu_N
#
# is its pressure drop: the element is passed laminarly, so the drop of its data sheet goes with
# flow and viscosity, until the bypass opens and holds it. Dirt blocks a share s of the element and
# leaves the flow to the rest of it, R / (1 - s).

_OPEN: Final = 1e-6
"""The share of an element that the dirt leaves open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    """A pressure filter behind the pump.

    Attributes:
        resistance: R, drop per flow of the clean element in this oil [Pa s/m³].
        bypass: P_by, the drop that the bypass holds [Pa]; infinite without one.

    Raises:
        ParameterError: for a value that is not positive.
    """

    resistance: float
    bypass: float = math.inf

    def __post_init__(self) -> None:
        require_positive("resistance", self.resistance, "Pa s/m³", "the filter")
        if self.bypass != math.inf:
            require_positive("bypass", self.bypass, "Pa", "the filter")

    def clogged(self, share: float) -> "Filter":
        """Return the filter with a share of its element blocked."""
        return replace(self, resistance=self.resistance / max(1.0 - share, _OPEN))

    def drop(self, flow: float) -> float:
        """Return the pressure drop [Pa] of a flow [m³/s]."""
        return min(self.resistance * flow, self.bypass)


ATMOSPHERE = 101_325.0
"""Standard atmosphere, absolute [Pa]."""


def require_exponent(symbol: str, value: float) -> None:
    """Refuse a polytropic exponent that no gas has.

    Raises:
        ParameterError: when `value` is not between 1, isothermal, and 2.
    """
    require_finite(symbol, value, "")
    if not 1.0 <= value <= 2.0:
        raise ParameterError(
            f"{symbol} = {value:g}: must be 1 (isothermal) to 2; adiabatic is 1.4", symbol
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EntrainedAir:
    """Undissolved air in the oil: the bulk modulus then falls with the pressure.

    Attributes:
        air_fraction: volume of the air in that of the mixture at atmospheric pressure [-].
        air_exponent: polytropic exponent of the air, 1 for slow and 1.4 for fast changes [-].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    air_fraction: float
    air_exponent: float = 1.4

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["air"])
        if self.air_fraction > 0.5:
            raise ParameterError(
                f"air_fraction = {self.air_fraction:g}: must be at most 0.5, or it is foam",
                "air_fraction",
            )
        require_exponent("air_exponent", self.air_exponent)

    @property
    def ratio(self) -> float:
        """Volume of the air over that of the oil at atmospheric pressure [-]."""
        return self.air_fraction / (1.0 - self.air_fraction)


@dataclass(frozen=True, slots=True, kw_only=True)
class LuGreFriction:
    """Friction with pre-sliding: bristles bend before they slip.

    The defaults bend by 0.09 mm before the F_s of Table I is reached.

    Attributes:
        sigma_0: stiffness of the bristles [N/m].
        sigma_1: damping of the bristles [N s/m].

    Raises:
        ParameterError: when the stiffness is not positive or the damping is negative.
    """

    sigma_0: float = 1e7
    sigma_1: float = 2e3

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["bristles"])


@dataclass(frozen=True, slots=True, kw_only=True)
class VariablePump:
    """A pump that swivels to hold a pressure.

    Attributes:
        senses_load: whether it holds its margin above the load's pressure, or the relief pressure.
        margin: above the pressure of the load [Pa]; also the error at which it swivels as fast as
            it can.
        swivel_time: from no flow to all of it [s].
        leakage: of the pump, from the supply to the tank [m³/(s Pa)].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    senses_load: bool
    margin: float = 2e6
    swivel_time: float = 0.1
    leakage: float = 2e-12

    def __post_init__(self) -> None:
        require_kind("senses_load", self.senses_load, bool)
        require_fields(self, ROWS.groups["pump"], "the pump")


@dataclass(frozen=True, slots=True, kw_only=True)
class SupplyUnit:
    """A pump, a relief valve and an accumulator behind port P.

    Attributes:
        pump_flow: of the pump, whatever the pressure; the largest of one that swivels [m³/s].
        relief_pressure: at which the relief valve begins to open [Pa].
        relief_gradient: flow through the relief valve per pressure above that [m³/(s Pa)].
        line_volume: of the oil between pump and valve [m³].
        accumulator_volume: of the accumulator's gas when it holds no oil [m³]; 0 for none.
        precharge_pressure: of that gas, as gauge pressure [Pa].
        gas_exponent: polytropic exponent of the gas [-].
        variable: how the pump swivels; None for one of constant flow.
        filter: between the pump with the relief valve and the line; None for none.

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    pump_flow: float = 1e-3
    relief_pressure: float = 1e7
    relief_gradient: float = 2e-9
    line_volume: float = 5e-4
    accumulator_volume: float = 1e-3
    precharge_pressure: float = 6e6
    gas_exponent: float = 1.4
    variable: VariablePump | None = None
    filter: Filter | None = None

    def __post_init__(self) -> None:
        require_kind("variable", self.variable, VariablePump, NoneType)
        require_kind("filter", self.filter, Filter, NoneType)
        require_fields(self, ROWS.groups["supply unit"])
        require_exponent("gas_exponent", self.gas_exponent)
        if self.accumulator_volume and self.precharge_pressure >= self.relief_pressure:
            raise ParameterError(
                f"precharge_pressure = {self.precharge_pressure:g} Pa: must be below "
                f"relief_pressure = {self.relief_pressure:g} Pa, or the accumulator never fills",
                "precharge_pressure",
                "relief_pressure",
            )
        if self.variable is None or not self.variable.senses_load:
            return
        if self.accumulator_volume:
            raise ParameterError(
                f"accumulator_volume = {self.accumulator_volume:g} m³: must be 0 with a "
                "load-sensing pump, whose pressure it would hold",
                "accumulator_volume",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class MeteringLands:
    """Edges of a spool that are not alike, and whose flow saturates with their opening.

    Attributes:
        gain_pa: of the edge from the supply to A, as a share of K [-].
        gain_at: of the edge from A to the tank [-].
        gain_pb: of the edge from the supply to B [-].
        gain_bt: of the edge from B to the tank [-].
        saturation: s of the flow a sqrt((1 + s) / (1 + s a²)) at a share a of the opening; 0 for a
            linear one [-].
        overlap_pa: dead zone of the edge from the supply to A, negative for an underlap [m]; None
            for that of the spool.
        overlap_at: the same of the edge from A to the tank.
        overlap_pb: the same of the edge from the supply to B.
        overlap_bt: the same of the edge from B to the tank.
        null_opening: x_0, the opening that leaks in the centre of a spool without overlap [m].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    gain_pa: float = 1.0
    gain_at: float = 1.0
    gain_pb: float = 1.0
    gain_bt: float = 1.0
    saturation: float = 0.0
    overlap_pa: float | None = None
    overlap_at: float | None = None
    overlap_pb: float | None = None
    overlap_bt: float | None = None
    null_opening: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["lands"])

    @property
    def overlaps(self) -> tuple[float | None, float | None, float | None, float | None]:
        """The overlaps of P-A, A-T, P-B and B-T [m]."""
        return self.overlap_pa, self.overlap_at, self.overlap_pb, self.overlap_bt

    @property
    def are_apart(self) -> bool:
        """Return True if both edges of a port may pass oil at once."""
        return bool(self.null_opening) or any(overlap is not None for overlap in self.overlaps)

    @property
    def largest_gain(self) -> float:
        """The gain of the widest edge [-]."""
        return max(self.gain_pa, self.gain_at, self.gain_pb, self.gain_bt)

    def gains(self, *, extends: bool) -> tuple[float, float]:
        """Return the gains of the edges that feed and drain the cylinder in a direction."""
        return (self.gain_pa, self.gain_bt) if extends else (self.gain_pb, self.gain_at)

    def bend(self, share: float) -> float:
        """Return the flow at a share of the opening, as a share of that of the wide open valve."""
        return share * math.sqrt((1.0 + self.saturation) / (1.0 + self.saturation * share * share))


@dataclass(frozen=True, slots=True, kw_only=True)
class CounterbalanceValve:
    """A valve in a line of the cylinder that holds a load until the other line's pressure opens it.

    Attributes:
        in_line_a: whether there is one between the valve and A.
        in_line_b: whether there is one between the valve and B.
        setting: pressure of the load that opens it without pilot [Pa].
        pilot_ratio: R, of the pilot's area to that of the load [-].
        span: pressure from the first opening to the full one [Pa].
        conductance: flow of the open valve over the root of its drop [m³/(s sqrt(Pa))].
        time_constant: of its spool with the damping nozzle [s].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    in_line_a: bool = False
    in_line_b: bool = False
    setting: float
    pilot_ratio: float
    span: float = 3e6
    conductance: float
    time_constant: float = 0.01

    def __post_init__(self) -> None:
        if not (self.in_line_a or self.in_line_b):
            raise ParameterError("in_line_a, in_line_b = False: must be in a line, or leave it out")
        of = "the counterbalance valve"
        require_fields(self, ROWS.groups["counterbalance"], of)
        require_positive("conductance", self.conductance, "m³/(s Pa^0.5)", of)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cushion:
    """A cushion near one end of the stroke: oil leaves through a throttle only.

    Attributes:
        length: before the end, over which it works [m].
        orifice: diameter of the throttle [m].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    length: float
    orifice: float

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["cushion_a"], "the cushion")

    @property
    def orifice_area(self) -> float:
        """Area of the throttle [m²]."""
        return 0.25 * math.pi * self.orifice * self.orifice
