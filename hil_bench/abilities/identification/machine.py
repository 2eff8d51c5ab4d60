"""The machine that is fitted: keys of `bench.toml` that are free, and the plant that they make.

An unknown is a key of the axis' table in its own unit, or one of a few names beside them: dead
volumes, the excess of static friction, how the supply yields, and delay, lag and offsets of the
sensors. A free variable is a multiple of the unknown's scale, or the logarithm of its ratio to it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.config.settings import Settings
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, build_axis
from hil_bench.plants.hydraulic_cylinder.keys import Supply
from hil_bench.plants.hydraulic_cylinder.model.constants import pack_extended
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, make_row
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.units import BAR, LITRE_PER_MINUTE, LITRE_PER_MINUTE_BAR, MILLIMETRE, NEWTON

Values = npt.NDArray[np.float64]

DEAD = {
    "dead_a": ("piston_side_volume_cm3", "piston_area_cm2"),
    "dead_b": ("rod_side_volume_cm3", "rod_side_area_cm2"),
}
"""Dead volumes beside what the piston sweeps, with the keys that they make up."""

STICTION, DROOP = "stiction_n", "supply_droop_bar_min_l"
SLEW = "spool_speed_mm_s"
PUMP, GAS = "supply_pump_share", "supply_gas_l"
DELAY, LAG = "position_delay_ms", "pressure_lag_ms"
OVERLAPS = ("land_overlap_pa_mm", "land_overlap_at_mm", "land_overlap_pb_mm", "land_overlap_bt_mm")
LEAKS = tuple(
    f"{way}_l_min_bar" for way in ("internal_leakage", "external_leakage_a", "external_leakage_b")
)
UNITS = {
    "dead_a": "cm3",
    "dead_b": "cm3",
    STICTION: "N",
    DROOP: "bar min/l",
    PUMP: "-",
    GAS: "l",
    DELAY: "ms",
    LAG: "ms",
    "offset_x": "mm",
    "offset_a": "bar",
    "offset_b": "bar",
}
"""Units of the unknowns that are no keys."""

_LINE_CM3 = 500.0  # between the droop's source and the valve
_PUMP, _GAS = 3.0, 0.1  # times the valve's largest flow that the droop's pump gives; litres of gas
_QUICK = 100.0  # full openings a second, the speed of a spool that is expected
_PRECHARGE = 0.6  # of the supply pressure


_BEGIN = {
    "flow_saturation": 0.3,
    "entrained_air_percent": 0.5,
    "null_opening_um": 0.2,
    "internal_leakage_l_min_bar": 0.3,
    "external_leakage_a_l_min_bar": 0.3,
    "external_leakage_b_l_min_bar": 0.3,
    STICTION: 0.5,
    DROOP: 0.3,
    DELAY: 0.5,
    LAG: 0.5,
}
"""Variables from which the search goes on where an unknown is at its bound of zero."""


class Unknown(NamedTuple):
    """An unknown and its free variable.

    Attributes:
        name: key or name; one for each recording ends in its number, as in ``offset_a:0``.
        is_log: whether the variable is the logarithm of the ratio to the scale.
        scale: in the unit of the key.
        low: bound of the variable.
        high: bound of the variable.
        spread: standard deviation of the variable about its start before anything is recorded.
        start: of the variable.
    """

    name: str
    is_log: bool
    scale: float
    low: float
    high: float
    spread: float
    start: float = 0.0

    def value(self, variable: float) -> float:
        """Return the value of the unknown in its unit."""
        return self.scale * (math.exp(variable) if self.is_log else variable)

    def slope(self, variable: float) -> float:
        """Return the slope of the value by the variable."""
        return self.scale * (math.exp(variable) if self.is_log else 1.0)

    @property
    def step(self) -> float:
        """Of the variable, for slopes: far from the next swing, and above the solver's noise."""
        return 2e-6 if self.is_log else 2e-6 * max(self.spread, 1.0)


class Running(NamedTuple):
    """A machine that runs.

    Attributes:
        parameters: of the plant.
        options: of the plant.
        constants: of the kernel.
        offsets: of the sensors in each recording, shape (recordings, 3) [m], [Pa].
        delay: of the position sensor [s].
        lag: of the pressure sensors [s].
        supply: pressure at rest [Pa].
    """

    parameters: PlantParameters
    options: PlantOptions
    constants: Floats
    offsets: Values
    delay: float
    lag: float
    supply: float


@dataclass(frozen=True, slots=True)
class Template:
    """The machine as it is configured, in which unknowns take other values.

    Attributes:
        axis: as configured.
        settings: of the axis.
        sessions: how many recordings there are.
        held: values that were found before, by the name of the unknown.
    """

    axis: CylinderConfig
    settings: Settings
    sessions: int
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def largest_flow(self) -> float:
        """Of the wide open valve without load [l/min]."""
        p = self.axis.parameters
        return LITRE_PER_MINUTE.from_si(p.K * p.alpha * math.sqrt(p.P_S - p.P_T))

    def keys(self, values: Mapping[str, float]) -> dict[str, float | str]:
        """Return the keys of `bench.toml` that unknowns make, in their units."""
        values = {**self.held, **values}
        own: dict[str, float | str] = {k: v for k, v in values.items() if k in self.settings}
        for name, (volume, area) in DEAD.items():
            moved = {volume, area, "stroke_mm"} & set(own)
            if name in values or moved - {volume}:
                dead = values.get(name, self.dead(name))
                swept = self._get(own, area) * self._get(own, "stroke_mm") * 0.05
                own[volume] = dead + swept
        if "spool_overlap_mm" in own and "orifice_full_opening_mm" not in own:
            # What 100 % stands for stays, so that the table of the valve's node need not change.
            full = self._get({}, "orifice_full_opening_mm") + self._get({}, "spool_overlap_mm")
            own["orifice_full_opening_mm"] = full - float(own["spool_overlap_mm"])
        coulomb = self._get(own, "coulomb_friction_n")
        if STICTION in values:
            own["static_friction_n"] = coulomb + values[STICTION]
        elif "static_friction_n" not in own and "coulomb_friction_n" in own:
            before = self._get({}, "coulomb_friction_n")
            ratio = self._get({}, "static_friction_n") / before if before else 1.0
            own["static_friction_n"] = max(ratio, 1.0) * coulomb
        if values.get(DROOP, 0.0) > 0.0:
            own |= self._droop(values, self._get(own, "supply_pressure_bar"))
        return own

    def dead(self, name: str) -> float:
        """Return a dead volume as configured [cm³]."""
        volume, area = DEAD[name]
        return self._get({}, volume) - self._get({}, area) * self._get({}, "stroke_mm") * 0.05

    def run(self, values: Mapping[str, float], dt: float) -> Running:
        """Return the machine that unknowns make; `ParameterError` where none does."""
        keys = self.keys(values)
        settings = self.settings | {
            key: self.settings[key]._replace(value=value) for key, value in keys.items()
        }
        axis = build_axis(self.axis.kind, self.axis.name, settings)
        parameters, options = axis.parameters, axis.options
        values = {**self.held, **values}
        offsets = [
            [values.get(f"offset_{name}:{session}", 0.0) for name in "xab"]
            for session in range(self.sessions)
        ]
        supply = parameters.P_S
        if options.supply is not None and options.supply.variable is None:
            unit = options.supply
            supply = unit.relief_pressure + unit.pump_flow / unit.relief_gradient
        return Running(
            parameters,
            options,
            make_row(pack_extended(parameters, options, dt)),
            np.array(offsets) * [MILLIMETRE.to_si(1.0), BAR.to_si(1.0), BAR.to_si(1.0)],
            1e-3 * values.get(DELAY, 0.0),
            1e-3 * values.get(LAG, 0.0),
            supply,
        )

    def unknown(self, name: str) -> Unknown:
        """Return an unknown.

        Raises:
            ConfigError: no number of the axis has this name.
        """
        base = name.partition(":")[0]
        p = self.axis.parameters
        force = NEWTON.from_si(0.02 * p.P_S * p.mean_area)
        opening = MILLIMETRE.from_si(p.full_opening)
        most = self.largest_flow
        leak = LITRE_PER_MINUTE_BAR.from_si(1e-3 * p.K * p.alpha / math.sqrt(p.P_S - p.P_T))
        ratios = {
            **dict.fromkeys(("bulk_modulus_mpa", SLEW, GAS), (4.0, 2.0)),
            **dict.fromkeys(("load_mass_kg", "spool_natural_frequency_rad_s"), (3.0, 0.3)),
            "moving_mass_kg": (3.0, 0.5),
            "spool_damping_ratio": (1.5, 0.3),
            **dict.fromkeys(("supply_pressure_bar", "relief_pressure_bar"), (0.7, 0.1)),
            **dict.fromkeys(("piston_area_cm2", "rod_side_area_cm2"), (0.1, 0.02)),
            "stroke_mm": (0.1, 0.01),
            **dict.fromkeys(DEAD, (5.0, 1.5)),
            PUMP: (4.0, 1.0),
            **{f"land_gain_{edge}": (1.2, 0.3) for edge in ("pa", "at", "pb", "bt")},
        }
        lines = {
            "spool_overlap_mm": (0.1 * opening, 0.0, 5.0, 1.0),
            **dict.fromkeys(("coulomb_friction_n", STICTION), (force, 0.0, 30.0, 2.0)),
            "viscous_friction_n_s_m": (10.0 * force, 0.0, 100.0, 5.0),
            "load_n": (force, -30.0, 30.0, 2.0),
            **dict.fromkeys(LEAKS, (leak, 0.0, 500.0, 10.0)),
            **dict.fromkeys(("flow_saturation", "entrained_air_percent"), (1.0, 0.0, 30.0, 3.0)),
            "null_opening_um": (10.0 * opening, 0.0, 10.0, 1.0),
            "tank_pressure_bar": (1.0, -0.9, 60.0, 3.0),
            DROOP: (0.02 * BAR.from_si(p.P_S) / most, 0.0, 50.0, 3.0),
            **dict.fromkeys((DELAY, LAG), (1.0, 0.0, 30.0, 3.0)),
            **dict.fromkeys(("offset_x", "offset_a", "offset_b"), (1.0, -20.0, 20.0, 1.0)),
            **dict.fromkeys(OVERLAPS, (0.1 * opening, -4.0, 5.0, 1.0)),
        }
        if base in lines:
            scale, low, high, spread = lines[base]
            start = min(max(self.start(name) / scale, low), high)
            return Unknown(name, False, scale, low, high, spread, start)
        if base in ratios or self._is_number(base):
            reach, spread = ratios.get(base, (3.0, 1.0))
            return Unknown(name, True, self.start(name) or 1.0, -reach, reach, spread)
        raise ConfigError(f"{base}: is no number of this axis that can be estimated")

    def begin(
        self, names: Sequence[str], values: Mapping[str, float]
    ) -> tuple[list[Unknown], Values]:
        """Return unknowns and the variables from which their search goes on.

        Args:
            names: of the unknowns.
            values: of those that were found before, in their units.
        """
        unknowns = [self.unknown(name) for name in names]
        variables = []
        for one in unknowns:
            if one.name not in values:
                variable = one.start
            elif one.is_log:
                variable = math.log(max(values[one.name], 1e-300) / one.scale)
            else:
                variable = values[one.name] / one.scale
            is_shut = one.name in _BEGIN and variable <= 0.0
            variables.append(_BEGIN[one.name] if is_shut else variable)
        return unknowns, np.array(variables)

    def start(self, name: str) -> float:
        """Return the value from which the search for an unknown starts, in its unit."""
        if name in self.held:
            return self.held[name]
        base = name.partition(":")[0]
        if base in DEAD:
            return self.dead(base)
        own = {PUMP: _PUMP, GAS: _GAS}
        if self.settings[SLEW].value is None:
            own[SLEW] = _QUICK * MILLIMETRE.from_si(self.axis.parameters.full_opening)
        if base in own:
            return own[base]
        if base == STICTION:
            static = self._get({}, "static_friction_n")
            return max(static - self._get({}, "coulomb_friction_n"), 0.0)
        if base in OVERLAPS and self.settings[base].value is None:
            return self.held.get("spool_overlap_mm", self._get({}, "spool_overlap_mm"))
        return self._get({}, base) if base in self.settings else 0.0

    def _is_number(self, name: str) -> bool:
        value = self.settings[name].value if name in self.settings else None
        return isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0

    def _get(self, own: Mapping[str, float | str], key: str) -> float:
        return float(own.get(key, self.held.get(key, self.settings[key].value)))

    def _droop(self, values: Mapping[str, float], pressure: float) -> dict[str, float | str]:
        """Return the keys of a supply whose pressure falls with the flow, and comes back."""
        droop = values[DROOP]
        pump = values.get(PUMP, _PUMP) * self.largest_flow
        return {
            "supply": Supply.UNIT,
            "pump_flow_l_min": pump,
            "relief_gradient_l_min_bar": 1.0 / droop,
            "relief_pressure_bar": max(pressure - pump * droop, 0.01),
            "supply_line_volume_cm3": _LINE_CM3,
            "accumulator_volume_l": values.get(GAS, _GAS),
            "accumulator_precharge_bar": _PRECHARGE * pressure,
        }


def read_values(unknowns: Sequence[Unknown], variables: Values) -> dict[str, float]:
    """Return the values that free variables stand for, by the unknown's name."""
    return {
        one.name: one.value(variable)
        for one, variable in zip(unknowns, variables.tolist(), strict=True)
    }
