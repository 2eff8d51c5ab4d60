"""The usual range of each key of a motor; valve, oil and supply as a cylinder's."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.plants.hydraulic_cylinder.plausible_ranges import POSSIBLE as POSSIBLE_OF_CYLINDERS
from hil_bench.plants.hydraulic_cylinder.plausible_ranges import SWING
from hil_bench.plants.hydraulic_cylinder.plausible_ranges import USUAL as USUAL_OF_CYLINDERS
from hil_bench.plants.kind import Range
from hil_bench.plants.rotary.keys import ROTARY_KEYS

_TORQUE = "up to a winch of 1000 kN m"
_NAMES = frozenset(key.name for key in ROTARY_KEYS)

USUAL: Final[Mapping[str, Range]] = MappingProxyType(
    {name: usual for name, usual in USUAL_OF_CYLINDERS.items() if name in _NAMES}
    | {
        "displacement_cm3_rev": Range(0.3, 50_000.0, "gear motors of 0.5 cm³ to radial pistons"),
        "inertia_kg_m2": Range(1e-5, 1e4, "a small gear motor's rotor to a drum"),
        "rated_speed_rpm": Range(5.0, 10_000.0, "radial pistons to small axial pistons"),
        "rated_pressure_bar": Range(30.0, 450.0, "the pressure drop over the motor"),
        "volumetric_efficiency_percent": Range(70.0, 99.9, "80 of orbit to 98 of axial pistons"),
        "hydromechanical_efficiency_percent": Range(60.0, 99.0, "80 of gears to 96 of pistons"),
        "starting_efficiency_percent": Range(50.0, 98.0, "70 of gears to 95 of radial pistons"),
        "volume_a_cm3": Range(0.5, 1e6, "passages to long lines"),
        "volume_b_cm3": Range(0.5, 1e6, "passages to long lines"),
        "coulomb_friction_n_m": Range(0.0, 1e5, "some percent of the stall torque"),
        "static_friction_n_m": Range(0.0, 1e5, "5 to 30 % of the stall torque"),
        "stribeck_speed_rpm": Range(0.1, 500.0, "bearings float from some turns a minute on"),
        "stribeck_exponent": Range(0.3, 3.0, "0.5 to 2 in the literature"),
        "load_torque_n_m": Range(-1e6, 1e6, _TORQUE),
        "load_inertia_kg_m2": Range(0.0, 1e5, "reduced to the motor's shaft, by the gear squared"),
    }
)

POSSIBLE: Final[Mapping[str, Range]] = MappingProxyType(
    {name: possible for name, possible in POSSIBLE_OF_CYLINDERS.items() if name in _NAMES}
)

_TURNS = Range(0.0, 10_000.0, "our choice: small axial pistons reach it")

USUAL_RESULTS: Final[Mapping[str, Range]] = MappingProxyType(
    {"top speed forwards": _TURNS, "top speed backwards": _TURNS, "eigenfrequency": SWING}
)
"""What machines reach, in the units of the facts."""
