"""The table ``[plant.NAME]`` of a hydraulic motor, and the cylinder that it is to the equations.

A motor of displacement D [m³/rad] is a cylinder whose chambers do not change: with a lever r, the
piston position x = r phi, the areas A_A = A_B = D / r and the mass J / r² turn Ruderman 2017 eqs.
(8) to (12) into those of a motor (Merritt 1967, section 6-3):

    V_A / E dP_A/dt = Q_A - D omega - C_i (P_A - P_B) - C_e (P_A - P_T)
    J domega/dt = (P_A - P_B) D - M_f(omega) - M_L

The equations are the same for any lever. With r³ = D the solver's tolerance, which is one of a
velocity, is as small a share of a motor's speed as of a piston's, whatever its size.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from hil_bench.config.settings import Origin, Problems, Settings, convert, read_rows
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder import keys, quantities
from hil_bench.plants.hydraulic_cylinder.configuration import (
    CylinderConfig,
    explain_refusal,
    hydraulic_options,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.derive import fill, ring_area
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import (
    Derived,
    Sheet,
    derive_oil,
    derive_pump,
    find_assumed_supply,
    find_oil,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import derive_valve
from hil_bench.plants.hydraulic_cylinder.keys import build_lines
from hil_bench.plants.hydraulic_cylinder.model.checks import check_lines
from hil_bench.plants.hydraulic_cylinder.model.extensions import SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
)
from hil_bench.plants.hydraulic_cylinder.model.models import Model, largest_stable_step
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.validation import SMALLEST
from hil_bench.plants.plant import SUPPLY, AxisConfig, Influence, PlantKind, Quantity, Shown

# The quantities of a hydraulic motor, named as those of the cylinder where they are the same.


ANGLE: Final = Quantity(
    "angle",
    "rad",
    0,
    tolerance=0.02,
    residual=0.2,
    is_anchor=True,
    shown=Shown("phi {:+z9.3f} rev", 0.15915494309189535),
)
"""Of the shaft, over all turns; a command that is late by 2 ms turns it by 0.2 rad at 950 rpm."""
SPEED: Final = Quantity("speed", "rad/s", 1, shown=Shown("n {:+z7.1f} rpm", 9.549296585513721))
TORQUE: Final = Quantity("torque", "N m", 5)
"""Torque of the oil on the shaft, before friction: (P_A - P_B) D."""

QUANTITIES: Final = (
    ANGLE,
    SPEED,
    quantities.PRESSURE_A._replace(output=2),
    quantities.PRESSURE_B._replace(output=3),
    quantities.SPOOL_SETPOINT,
    quantities.SPOOL_POSITION._replace(output=4),
    TORQUE,
    quantities.FLOW_A._replace(output=6),
    quantities.FLOW_B._replace(output=7),
)

LOAD: Final = "load"
"""Torque on the shaft from outside [N m], positive against positive rotation."""


# The keys of a motor's table ``[plant.NAME]``; valve, oil and supply have those of the cylinder.
#
# `parameters.tsv` declares the motor's own.


_ROWS: Final = read_rows(Path(__file__).with_name("parameters.tsv"))

MOTOR_KEYS: Final = _ROWS.groups["motor"]
"""Keys that each motor needs."""

RATING_KEYS: Final = _ROWS.groups["rating"]
"""Of the data sheet: efficiencies, and speed and pressure drop at which they hold."""

LINE_KEYS: Final = tuple(key for key in keys.CYLINDER_SHEET if key.name.startswith("line_"))
VOLUME_KEYS: Final = _ROWS.groups["volumes"]
FRICTION_KEYS: Final = _ROWS.groups["friction"]
LOAD_KEYS: Final = _ROWS.groups["load"]
(SERIES_KEY,) = _ROWS.groups["series"]
(ANGLE_KEY,) = _ROWS.groups["angle"]

_OF_PISTON = {"A_A", "A_B", "V_A0", "V_B0", "m", "F_c", "F_s", "sigma", "chi", "delta", "h"}
HYDRAULIC_KEYS: Final = tuple(key for key in keys.PARAMETER_KEYS if key.field not in _OF_PISTON)
"""Those of the cylinder's parameters that its valve, its oil and its supply have."""

_OF_CYLINDER = {"signed_root", "tanh_gain_s_m"}
VALVE_OPTION_KEYS: Final = tuple(key for key in keys.OPTION_KEYS if key.name not in _OF_CYLINDER)

DATA_SHEET_KEYS: Final = (
    *RATING_KEYS,
    *LINE_KEYS,
    *keys.VALVE_SHEET,
    *keys.OIL_SHEET,
    *keys.PUMP_SHEET,
)

ROTARY_KEYS: Final = (
    *MOTOR_KEYS,
    *DATA_SHEET_KEYS,
    *VOLUME_KEYS,
    *FRICTION_KEYS,
    *HYDRAULIC_KEYS,
    *VALVE_OPTION_KEYS,
    keys.CAVITATION_KEY,
    *keys.CAVITATION_KEYS,
    *keys.AIR_KEYS,
    *keys.LAND_KEYS,
    keys.LINE_MODEL_KEY,
    *keys.WALL_KEYS["a"],
    *keys.WALL_KEYS["b"],
    keys.COMPENSATOR_KEY,
    keys.SUPPLY_KEY,
    *keys.SUPPLY_KEYS,
    keys.VISCOSITY_KEY,
    *keys.FILTER_KEYS,
    *LOAD_KEYS,
    SERIES_KEY,
    ANGLE_KEY,
)


# Leakage, friction and volumes of a motor from its data sheet; valve and oil as a cylinder's.

PORT_SHARE = 1.0
"""A typical volume of the motor's passages on each side, as a share of the displacement."""

VISCOUS_SHARE = 0.5
"""A typical part of the friction at rated speed that grows with the speed."""

STARTING_SHARE = 2.0
"""A typical friction at the start, as a multiple of that at rated speed."""

_POINT = ("rated_speed_rpm", "rated_pressure_bar")
_EFFICIENCIES = tuple(key.name for key in RATING_KEYS if key.name not in _POINT)
_VOLUMETRIC, _HYDROMECHANICAL, _STARTING = _EFFICIENCIES


def leakage(displacement: float, speed: float, drop: float, efficiency: float) -> float:
    """Return the leakage C = D omega (1 / eta_v - 1) / dp of a motor [m³/(s Pa)] (ISO 4391).

    Args:
        displacement: D [m³/rad].
        speed: omega at which the efficiency holds [rad/s].
        drop: dp at which it holds [Pa].
        efficiency: eta_v [-].
    """
    return displacement * speed * (1.0 / efficiency - 1.0) / drop


def friction_torque(displacement: float, drop: float, efficiency: float) -> float:
    """Return the torque (1 - eta_hm) D dp that a motor loses [N m] (ISO 4391).

    Args:
        displacement: D [m³/rad].
        drop: dp over the motor [Pa].
        efficiency: eta_hm [-].
    """
    return (1.0 - efficiency) * displacement * drop


def apply_data_sheet(settings: Settings, problems: Problems) -> Settings:
    """Return the settings of a motor with the physical keys that its data sheets determine.

    Args:
        settings: of the axis, one for each key.
        problems: where problems are noted: data that are missing, given twice or impossible.
    """
    sheet = Sheet(settings, problems)
    of_oil = list(sheet.take(derive_oil(sheet, find_oil(sheet))))
    density = next((each.value for each in of_oil if each.key == "oil_density_kg_m3"), None)
    density = sheet.number("oil_density_kg_m3") if density is None else density
    derived = [
        *of_oil,
        *sheet.take(_derive_losses(sheet)),
        *(each for side in "ab" for each in sheet.take(_derive_volume(sheet, side))),
        *sheet.take(derive_valve(sheet, density)),
        *sheet.take(derive_pump(sheet)),
    ]
    return settings | {each.key: fill(settings, each) for each in derived}


def find_leftovers(settings: Settings) -> Iterator[tuple[str, str]]:
    """Yield the keys of which nothing is said, and what stands there instead."""
    yield from find_assumed_supply(settings)
    for key, what, right in (
        ("orifice_width_mm", "the valve is", "rated_flow_l_min and rated_pressure_drop_bar"),
        ("bulk_modulus_mpa", "the oil is", 'oil = "HLP 46" or bulk_modulus_mpa'),
        ("supply_pressure_bar", "the supply is", "supply_pressure_bar"),
    ):
        if settings[key].origin is Origin.DEFAULT:
            value = settings[key].value
            yield key, f"{value:g}: {what} that of Ruderman 2017, Table I; give {right}"
    friction = [settings[name].origin for name in ("coulomb_friction_n_m", _HYDROMECHANICAL)]
    if all(origin is Origin.DEFAULT for origin in friction):
        right = "give hydromechanical_efficiency_percent, or 0 if it is so"
        yield "coulomb_friction_n_m", f"0: a motor without friction; {right}"


def _derive_losses(sheet: Sheet) -> Iterator[Derived]:
    """Yield what the efficiencies of a motor at its rated point determine."""
    given = sheet.given(_EFFICIENCIES)
    if not given:
        if point := sheet.given(_POINT):
            right = f"give {_HYDROMECHANICAL} too"
            sheet.refuse(point[0], f"says nothing without an efficiency; {right}")
        return
    if not sheet.require(given[0], zip(_POINT, ("1500", "200"), strict=True)):
        return
    displacement, speed, drop = (sheet.si(name) for name in ("displacement_cm3_rev", *_POINT))
    if sheet.has(_VOLUMETRIC):
        leak = leakage(displacement, speed, drop, sheet.si(_VOLUMETRIC))
        unit = sheet.settings["internal_leakage_l_min_bar"].key.unit
        sources = (_VOLUMETRIC, *_POINT)
        yield Derived("internal_leakage_l_min_bar", unit.from_si(leak), sources)
    if not sheet.has(_HYDROMECHANICAL):
        if sheet.has(_STARTING):
            sheet.refuse(_STARTING, f"says nothing by itself; give {_HYDROMECHANICAL} too")
        return
    sources = (_HYDROMECHANICAL, *_POINT)
    lost = friction_torque(displacement, drop, sheet.si(_HYDROMECHANICAL))
    part = f"{VISCOUS_SHARE:.0%} of it grow with the speed".replace("%", " %")
    coulomb, viscous = (1.0 - VISCOUS_SHARE) * lost, VISCOUS_SHARE * lost / speed
    yield Derived("coulomb_friction_n_m", coulomb, sources, part)
    yield Derived("viscous_friction_n_m_s", viscous, sources, part)
    if not sheet.has(_STARTING):
        many = f"{STARTING_SHARE:g} times that at rated speed"
        yield Derived("static_friction_n_m", STARTING_SHARE * lost, sources, many, yields=True)
        return
    static = friction_torque(displacement, drop, sheet.si(_STARTING))
    if static < coulomb:
        right = "give less, for friction is largest at the start"
        sheet.refuse(_STARTING, f"is above what {_HYDROMECHANICAL} leaves at speed 0; {right}")
    yield Derived("static_friction_n_m", static, (_STARTING, *_POINT))


def _derive_volume(sheet: Sheet, side: str) -> Iterator[Derived]:
    """Yield the volume between the valve and the rotor on one side."""
    length, inner = f"line_{side}_length_m", f"line_{side}_inner_mm"
    has_waves = sheet.settings["line_model"].value is keys.LineModel.WAVES
    lines = () if has_waves else sheet.given((length, inner))
    if len(lines) == 1:
        other = inner if lines[0] == length else length
        sheet.refuse(lines[0], f"does not say the line's volume by itself; give {other} too")
        return
    line = ring_area(sheet.si(inner), 0.0) * sheet.si(length) * 1e6 if lines else 0.0
    ports = PORT_SHARE * sheet.number("displacement_cm3_rev")
    typical = "passages as large as the displacement"
    sources = ("displacement_cm3_rev", *lines)
    yield Derived(f"volume_{side}_cm3", line + ports, sources, typical, yields=not lines)


SIGN_STEEPNESS: Final = 8.0
"""The sign of the speed is tanh(8 omega / omega_S): as steep as Table I has it for its piston."""

TORQUE_LIMIT: Final = 1e7
"""Largest load torque [N m]."""


@dataclass(frozen=True, slots=True)
class RotaryConfig(AxisConfig):
    """A hydraulic motor and the hydraulic side of its valve.

    Attributes:
        displacement: D [m³/rad].
        angle: of the shaft at the start [rad].
        cylinder: what the motor is to the equations.
    """

    displacement: float
    angle: float
    cylinder: CylinderConfig

    def fed_by(self, unit: SupplyUnit) -> "RotaryConfig":
        """Return the axis with another supply unit."""
        return replace(self, cylinder=self.cylinder.fed_by(unit))

    @property
    def lever(self) -> float:
        """The lever r at which the piston moves as the motor turns [m]."""
        return lever(self.displacement)

    @property
    def full_scale(self) -> float:
        """The spool position from which on the orifices are fully open [m]."""
        return self.cylinder.full_scale

    @property
    def influences(self) -> tuple[Influence, ...]:
        """A load torque, and a supply pressure not below that of the tank."""
        (supply,) = (each for each in self.cylinder.influences if each.name == SUPPLY)
        return Influence(LOAD, "N m", -TORQUE_LIMIT, TORQUE_LIMIT), supply

    @property
    def defects(self) -> tuple[Influence, ...]:
        """The defects of a cylinder, without friction that is a force."""
        return tuple(each for each in self.cylinder.defects if each.unit != "N")


def lever(displacement: float) -> float:
    """Return the lever r with r³ = D [m]."""
    return float(displacement ** (1.0 / 3.0))


def configure(
    kind: PlantKind["RotaryConfig"], name: str, settings: Settings, step_us: int, problems: Problems
) -> RotaryConfig | None:
    """Return the record of an axis; what makes no physical sense is noted, and None returned."""
    if not _is_sound(name, settings, problems):
        return None
    motor = convert(settings, (*MOTOR_KEYS, *VOLUME_KEYS, *FRICTION_KEYS, *LOAD_KEYS, SERIES_KEY))
    try:
        cylinder = _build_cylinder(kind, name, settings, motor)
        check_lines(cylinder.parameters, cylinder.options, step_us * 1e-6)
    except ParameterError as error:
        explain_refusal(f"plant.{name}", error, problems)
        return None
    _check_step(cylinder, step_us, problems)
    angle = convert(settings, (ANGLE_KEY,))["angle"]
    return RotaryConfig(name, kind, motor["displacement"], angle, cylinder)


def _is_sound(name: str, axis: Settings, problems: Problems) -> bool:
    """Note what is wrong with the volumes and the friction, which no model sees as they are."""
    static, coulomb = (axis[f"{word}_friction_n_m"].value for word in ("static", "coulomb"))
    if static and static < coulomb:
        wrong = f"{static:g} is below coulomb_friction_n_m = {coulomb:g}; give that or more"
        problems.add(problems.place(f"plant.{name}", "static_friction_n_m"), wrong)
        return False
    return True


def _build_cylinder(
    kind: PlantKind["RotaryConfig"], name: str, axis: Settings, motor: dict[str, Any]
) -> CylinderConfig:
    """Return the cylinder whose piston moves, at the lever, as the motor turns."""
    D, r = motor["displacement"], lever(motor["displacement"])  # noqa: N806 - Merritt's symbol
    stribeck = motor["stribeck"] * r
    parameters = PlantParameters(
        **convert(axis, HYDRAULIC_KEYS),
        A_A=D / r,
        A_B=D / r,
        V_A0=motor["a"],
        V_B0=motor["b"],
        m=motor["inertia"] / r**2,
        F_c=motor["coulomb"] / r,
        F_s=max(motor["static"], motor["coulomb"]) / r,
        sigma=(motor["viscous"] + motor["damping"]) / r**2,
        chi=stribeck,
        delta=motor["exponent"],
        h=SMALLEST,  # the volumes do not change, however far the shaft turns
    )
    of_axis: dict[str, Any] = hydraulic_options(axis) | build_lines(axis)
    options = PlantOptions(
        **convert(axis, VALVE_OPTION_KEYS),
        **of_axis,
        tanh_gain=SIGN_STEEPNESS / stribeck,
        loads=_build_loads(motor, r),
    )
    return CylinderConfig(
        name=name,
        kind=kind,
        model=Model.FULL_ORDER,
        parameters=parameters,
        options=options,
        solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
        position=0.0,
        spool_delay=0.0,
        is_fed=axis["supply"].value not in set(keys.Supply),
    )


def _build_loads(motor: dict[str, Any], r: float) -> tuple[Load, ...]:
    loads: list[Load] = []
    if motor["torque"]:
        loads.append(ConstantLoad(motor["torque"] / r))
    if motor["mass"]:
        loads.append(MassOnSlope(motor["mass"] / r**2))
    if motor["series"]:
        times, torques = zip(*motor["series"], strict=True)
        loads.append(LoadSeries(times, tuple(torque / r for torque in torques)))
    return tuple(loads)


def _check_step(cylinder: CylinderConfig, step_us: int, problems: Problems) -> None:
    """Note a step that is too long for the motor's swing on the oil."""
    solver = cylinder.solver
    limit_us = 1e6 * largest_stable_step(
        cylinder.model, cylinder.parameters, cylinder.options, solver
    )
    if step_us > limit_us:
        right = "a larger inertia_kg_m2 or larger volumes"
        if limit_us >= 1.0:
            right = f"bench.step_us = {math.floor(limit_us)}"
        wrong = f"its swing on the oil is too fast for step_us = {step_us}"
        place = problems.place(f"plant.{cylinder.name}", "inertia_kg_m2")
        problems.add(place, f"{wrong}; give {right}")
