"""Explicit choices for the points that the paper leaves open about its model."""

import math
from dataclasses import dataclass
from types import NoneType
from typing import Self

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    ATMOSPHERE,
    CounterbalanceValve,
    Cushion,
    EntrainedAir,
    LuGreFriction,
    MeteringLands,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
    SpringLoad,
)
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    ROWS,
    require_fields,
    require_finite,
    require_kind,
    require_positive,
)
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

_NUMBERS = (
    *(key for key in ROWS.groups["options"] if key.accepts),
    *ROWS.groups["compensator"],
)

VACUUM_PRESSURE = -ATMOSPHERE
"""Absolute vacuum as a gauge pressure, under the standard atmosphere [Pa]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EndStop:
    """The cylinder's end caps: a spring and a damper at x = +h and x = -h that push and never pull.

    At rest the piston sinks in by force / stiffness: by 0.25 mm under the 50 kN of Table I at full
    supply pressure. An impact at full speed (0.5 m/s) takes it 0.5 mm deep at the most, for moving
    masses up to 500 kg.

    Attributes:
        stiffness: of the contact [N/m].
        damping: of the contact [N s/m].

    Raises:
        ParameterError: when the stiffness is not positive or the damping is negative.
    """

    stiffness: float = 2e8
    damping: float = 2e4

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["end stop"], "the end stop")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantOptions:
    """The full-order model's choices where the paper is open; the defaults are the paper's.

    Attributes:
        signed_root: whether the flow of eqs. (5), (6) turns round when the pressure drop does;
            otherwise it is held at zero.
        tanh_gain: slope of the tanh that stands for the sign in eq. (13) [s/m]; `math.inf` is the
            printed sign (forward Euler only).
        end_stop: what stops the piston at the stroke's ends; None lets it run on, as printed.
        cavitation_floor: gauge pressure below which no chamber falls [Pa]; None for no floor.
        laminar_transition: pressure drop below which orifice flow is laminar [Pa]; 0 turns it off.
        alpha_negative: alpha of eq. (2) for negative spool positions [m]; None for the same alpha.
        beta_negative: beta of eq. (2) for negative spool positions [m]; None for the same beta.
        spool_speed: of the spool at most [m/s]; None for no limit.
        C_LA: external leakage coefficient, chamber A to the tank [m³/(s Pa)].
        C_LB: external leakage coefficient, chamber B to the tank [m³/(s Pa)].
        air: what is entrained in the oil; None for the constant E.
        bristles: LuGre friction in place of the tanh in eq. (13); None for the static curve.
        lands: gains and saturation of the metering edges; None for four like edges.
        compensator_margin: what a pressure compensator lets drop over an edge that feeds [Pa]; None
            for no compensator.
        cushion_a: at the end at which A is empty; None for none.
        cushion_b: at the end at which B is empty; None for none.
        counterbalance: what holds the load in line A, in line B or in both; None for nothing.
        line_a: from the valve to A, where its waves are to be seen; None for a volume of chamber A.
        line_b: the same to B.
        supply: what holds P_S up; None for the constant P_S.
        loads: what acts on the rod besides the F_L of each step; one series at the most.

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    signed_root: bool = True
    tanh_gain: float = 400.0
    end_stop: EndStop | None = None
    cavitation_floor: float | None = None
    laminar_transition: float = 0.0
    alpha_negative: float | None = None
    beta_negative: float | None = None
    spool_speed: float | None = None
    C_LA: float = 0.0
    C_LB: float = 0.0
    air: EntrainedAir | None = None
    bristles: LuGreFriction | None = None
    lands: MeteringLands | None = None
    compensator_margin: float | None = None
    cushion_a: Cushion | None = None
    cushion_b: Cushion | None = None
    counterbalance: CounterbalanceValve | None = None
    line_a: Line | None = None
    line_b: Line | None = None
    supply: SupplyUnit | None = None
    loads: tuple[Load, ...] = ()

    def __post_init__(self) -> None:
        self._check_kinds()
        if self.tanh_gain != math.inf:
            require_positive("tanh_gain", self.tanh_gain, "s/m")
        require_fields(self, _NUMBERS)
        if sum(isinstance(load, LoadSeries) for load in self.loads) > 1:
            raise ParameterError(
                "load_series = several: must be one at the most; add them up", "load_series"
            )
        if self.cavitation_floor is not None:
            require_finite("cavitation_floor", self.cavitation_floor, "Pa")
            if self.cavitation_floor > 0.0 or self.cavitation_floor < VACUUM_PRESSURE - 1.0:
                raise ParameterError(
                    f"cavitation_floor = {self.cavitation_floor:g} Pa: must be 0 or less, "
                    f"as a gauge pressure (absolute vacuum is {VACUUM_PRESSURE:g} Pa)",
                    "cavitation_floor",
                )

    def _check_kinds(self) -> None:
        require_kind("signed_root", self.signed_root, bool)
        require_kind("end_stop", self.end_stop, EndStop, NoneType)
        require_kind("air", self.air, EntrainedAir, NoneType)
        require_kind("bristles", self.bristles, LuGreFriction, NoneType)
        require_kind("lands", self.lands, MeteringLands, NoneType)
        require_kind("cushion_a", self.cushion_a, Cushion, NoneType)
        require_kind("cushion_b", self.cushion_b, Cushion, NoneType)
        require_kind("counterbalance", self.counterbalance, CounterbalanceValve, NoneType)
        require_kind("line_a", self.line_a, Line, NoneType)
        require_kind("line_b", self.line_b, Line, NoneType)
        require_kind("supply", self.supply, SupplyUnit, NoneType)
        require_kind("loads", self.loads, tuple)
        for load in self.loads:
            require_kind("loads", load, ConstantLoad, SpringLoad, MassOnSlope, LoadSeries)

    @property
    def is_extended(self) -> bool:
        """Return True if anything is on that the paper's equations do not have."""
        extensions = (self.air, self.bristles, self.lands, self.supply)
        return bool(self.C_LA or self.C_LB or self.loads or self.has_edges) or any(
            extension is not None for extension in extensions
        )

    @property
    def has_edges(self) -> bool:
        """Return True if each of the four edges of the valve is stepped for itself."""
        components = (self.compensator_margin, self.cushion_a, self.cushion_b)
        are_apart = self.lands is not None and self.lands.are_apart
        return (
            are_apart
            or self.has_lines
            or self.has_moving_components
            or any(component is not None for component in components)
        )

    @property
    def has_moving_components(self) -> bool:
        """Return True if there are valves or pumps with states of their own."""
        is_variable = self.supply is not None and self.supply.variable is not None
        return is_variable or self.counterbalance is not None

    @property
    def has_lines(self) -> bool:
        """Return True if waves run between valve and cylinder."""
        return self.line_a is not None or self.line_b is not None

    @property
    def load_mass(self) -> float:
        """The mass that the loads add to the moving mass m [kg]."""
        return sum(load.load_mass for load in self.loads if isinstance(load, MassOnSlope))

    def load_at(self, x: float, t: float = 0.0) -> float:
        """Return the force of all loads [N] at piston position x [m] and time t [s]."""
        return math.fsum(load.force_at(x, t) for load in self.loads)

    @classmethod
    def paper(cls) -> Self:
        """Return the model as the paper simulated it: no end stop, no floor, all turbulent."""
        return cls()

    @classmethod
    def bench(cls) -> Self:
        """Return the model for a test bench: piston and pressures stay where they can be."""
        return cls(end_stop=EndStop(), cavitation_floor=VACUUM_PRESSURE, laminar_transition=300.0)
