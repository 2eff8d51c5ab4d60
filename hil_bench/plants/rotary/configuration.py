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
from dataclasses import dataclass, replace
from typing import Any, Final

from hil_bench.config.settings import Problems, Settings, convert
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.configuration import (
    CylinderConfig,
    explain_refusal,
    hydraulic_options,
)
from hil_bench.plants.hydraulic_cylinder.keys import Supply
from hil_bench.plants.hydraulic_cylinder.line_settings import build_lines
from hil_bench.plants.hydraulic_cylinder.model.checks import check_lines
from hil_bench.plants.hydraulic_cylinder.model.extensions import SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.loads import (
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
from hil_bench.plants.kind import AxisConfig, PlantKind
from hil_bench.plants.quantity import SUPPLY, Influence
from hil_bench.plants.rotary.keys import (
    ANGLE_KEY,
    FRICTION_KEYS,
    HYDRAULIC_KEYS,
    LOAD_KEYS,
    MOTOR_KEYS,
    SERIES_KEY,
    VALVE_OPTION_KEYS,
    VOLUME_KEYS,
)
from hil_bench.plants.rotary.quantities import LOAD

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
    kind: PlantKind["RotaryConfig"], name: str, axis: Settings, step_us: int, problems: Problems
) -> RotaryConfig | None:
    """Return the record of an axis; what makes no physical sense is noted, and None returned."""
    if not _is_sound(name, axis, problems):
        return None
    motor = convert(axis, (*MOTOR_KEYS, *VOLUME_KEYS, *FRICTION_KEYS, *LOAD_KEYS, SERIES_KEY))
    try:
        cylinder = _build_cylinder(kind, name, axis, motor)
        check_lines(cylinder.parameters, cylinder.options, step_us * 1e-6)
    except ParameterError as error:
        explain_refusal(f"plant.{name}", error, problems)
        return None
    _check_step(cylinder, step_us, problems)
    angle = convert(axis, (ANGLE_KEY,))["angle"]
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
        is_fed=axis["supply"].value not in set(Supply),
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
