"""The usual and the possible range of each physical key of a cylinder.

The table is data: `hil_bench.bench.configuration.plausibility` compares a configuration with it.
"""

import math
from collections.abc import Mapping
from typing import Final

from hil_bench.plants.kind import Range

_PRESSURE = "up to 350 bar in machines, 1000 in presses and tools"
_AREA = "bores of 4 mm to 1.1 m"
_VOLUME = "a miniature cylinder to a press"
_LEAK = "a sound seal lets 0 through, a worn one some ml/min for each bar"
_FORCE = "up to a press of 1000 t"
_SPOOL = "spools of size 4 to 32 travel 0.3 to 15 mm"
_LAND = "edges differ by some percent, those of a spool 2:1 by half"
_OVERLAP = "up to a third of the travel, negative for edges that are open in the centre"
_CUSHION = "ISO 6020 cylinders have 15 to 60 mm"
_HOSE = "100 of expanding hoses to 1500 of steel pipes; 500 to 1000 of hydraulic hoses"
_EXPONENT = "1 is isothermal, 1.4 adiabatic, 1.67 that of a noble gas"

USUAL: Final[Mapping[str, Range]] = {
    "spool_delay_ms": Range(0.0, 100.0, "solenoids answer within tens of milliseconds"),
    "orifice_full_opening_mm": Range(0.05, 20.0, _SPOOL),
    "orifice_full_opening_negative_mm": Range(0.05, 20.0, _SPOOL),
    "spool_overlap_mm": Range(0.0, 5.0, "up to a third of the travel"),
    "spool_overlap_negative_mm": Range(0.0, 5.0, "up to a third of the travel"),
    "spool_natural_frequency_rad_s": Range(20.0, 6000.0, "3 Hz of pilots to 1 kHz of servo-valves"),
    "spool_damping_ratio": Range(0.2, 5.0, "position loops are set between"),
    "discharge_coefficient": Range(0.5, 1.0, "0.6 of a sharp edge to 0.98 of a round one"),
    "orifice_width_mm": Range(0.5, 200.0, "a notch to the circumference of a spool of 60 mm"),
    "oil_density_kg_m3": Range(700.0, 1500.0, "mineral oil 850, water glycol 1080, esters 1150"),
    "bulk_modulus_mpa": Range(50.0, 3000.0, "oil 1400 to 2000, much less with air and hoses"),
    "supply_pressure_bar": Range(5.0, 1000.0, _PRESSURE),
    "tank_pressure_bar": Range(-0.5, 50.0, "a return line with its filter"),
    "internal_leakage_l_min_bar": Range(0.0, 1.0, _LEAK),
    "external_leakage_a_l_min_bar": Range(0.0, 1.0, _LEAK),
    "external_leakage_b_l_min_bar": Range(0.0, 1.0, _LEAK),
    "piston_area_cm2": Range(0.1, 10_000.0, _AREA),
    "rod_side_area_cm2": Range(0.05, 10_000.0, _AREA),
    "piston_side_volume_cm3": Range(0.5, 1e6, _VOLUME),
    "rod_side_volume_cm3": Range(0.5, 1e6, _VOLUME),
    "moving_mass_kg": Range(0.05, 1e6, "a piston of 10 mm to a press of 1000 t"),
    "coulomb_friction_n": Range(0.0, 1e6, "some percent of what the cylinder can push"),
    "static_friction_n": Range(0.0, 2e6, "up to twice the Coulomb friction"),
    "viscous_friction_n_s_m": Range(0.0, 1e6, "seals and oil films"),
    "stribeck_velocity_mm_s": Range(0.1, 500.0, "seals are lubricated from some mm/s on"),
    "stribeck_exponent": Range(0.3, 3.0, "0.5 to 2 in the literature"),
    "stroke_mm": Range(1.0, 30_000.0, "a clamp to a telescope"),
    "tanh_gain_s_m": Range(10.0, 1e6, "the sign of the speed is smooth below its inverse"),
    "laminar_transition_pa": Range(0.0, 5e6, "the drop at which flow becomes turbulent"),
    "end_stop_stiffness_n_mm": Range(100.0, 1e8, "rubber to a solid head"),
    "end_stop_damping_n_s_m": Range(0.0, 1e8, "up to an impact without rebound"),
    "cavitation_floor_bar": Range(-1.01325, 0.0, "oil boils out below the atmosphere"),
    "entrained_air_percent": Range(0.0, 20.0, "0.5 to 5 in machines"),
    "entrained_air_exponent": Range(1.0, 1.67, _EXPONENT),
    "bristle_stiffness_n_mm": Range(10.0, 1e6, "micrometres to tenths of a millimetre of bending"),
    "bristle_damping_n_s_m": Range(0.0, 1e6, "as the viscous friction"),
    "pump_flow_l_min": Range(0.05, 3000.0, "a micro pump to a large variable one"),
    "relief_pressure_bar": Range(5.0, 1000.0, _PRESSURE),
    "relief_gradient_l_min_bar": Range(0.05, 1000.0, "full flow within 1 to 20 % of the pressure"),
    "supply_line_volume_cm3": Range(1.0, 1e6, "a bore in a block to long pipes"),
    "accumulator_volume_l": Range(0.0, 1000.0, "0.02 to 450 l are made; 0 for none"),
    "accumulator_precharge_bar": Range(1.0, 700.0, _PRESSURE),
    "accumulator_exponent": Range(1.0, 1.67, _EXPONENT),
    "land_gain_pa": Range(0.1, 2.0, _LAND),
    "land_gain_at": Range(0.1, 2.0, _LAND),
    "land_gain_pb": Range(0.1, 2.0, _LAND),
    "land_gain_bt": Range(0.1, 2.0, _LAND),
    "land_overlap_pa_mm": Range(-2.0, 5.0, _OVERLAP),
    "land_overlap_at_mm": Range(-2.0, 5.0, _OVERLAP),
    "land_overlap_pb_mm": Range(-2.0, 5.0, _OVERLAP),
    "land_overlap_bt_mm": Range(-2.0, 5.0, _OVERLAP),
    "null_opening_um": Range(0.0, 200.0, "a clearance of some micrometres, more where it is worn"),
    "compensator_margin_bar": Range(2.0, 40.0, "springs of 4 to 25 bar"),
    "cushion_a_length_mm": Range(2.0, 300.0, _CUSHION),
    "cushion_b_length_mm": Range(2.0, 300.0, _CUSHION),
    "cushion_a_orifice_mm": Range(0.2, 30.0, "a throttle of some percent of the port"),
    "cushion_b_orifice_mm": Range(0.2, 30.0, "a throttle of some percent of the port"),
    "counterbalance_setting_bar": Range(30.0, 450.0, "1.2 to 1.3 times the largest load pressure"),
    "counterbalance_pilot_ratio": Range(0.0, 10.0, "1.5 to 10 are made, 3 and 4 are common"),
    "counterbalance_opening_bar": Range(5.0, 350.0, "to the full opening; wide ones damp"),
    "counterbalance_time_ms": Range(2.0, 300.0, "5 without, 100 with a damping nozzle"),
    "counterbalance_rated_flow_l_min": Range(1.0, 1000.0, "cartridges of 10 to 500 l/min"),
    "counterbalance_rated_drop_bar": Range(2.0, 70.0, "5 to 30 of the open valve"),
    "pump_margin_bar": Range(5.0, 40.0, "14 to 30 bar of load-sensing pumps"),
    "pump_swivel_time_ms": Range(20.0, 1000.0, "50 to 200 ms of axial piston pumps"),
    "pump_leakage_l_min_bar": Range(1e-4, 0.2, "2 to 10 % of the flow at the rated pressure"),
    "filter_rated_flow_l_min": Range(1.0, 3000.0, "size 30 to 1300 of makers"),
    "filter_rated_drop_bar": Range(0.05, 10.0, "0.2 to 1 bar of clean elements"),
    "filter_rated_viscosity_mm2_s": Range(10.0, 100.0, "30 in most data sheets"),
    "filter_bypass_bar": Range(1.0, 30.0, "2 to 8 bar, where there is one"),
    "null_leakage_l_min": Range(0.01, 50.0, "0.1 of small servo-valves to some l/min"),
    "null_leakage_pressure_bar": Range(50.0, 400.0, "data sheets say it at 100 to 315 bar"),
    "flow_saturation": Range(0.0, 20.0, "0 of a linear valve"),
    "load_n": Range(-1e7, 1e7, _FORCE),
    "load_spring_n_mm": Range(0.0, 1e6, "springs and machine frames"),
    "load_spring_rest_mm": Range(-30_000.0, 30_000.0, "within the reach of the cylinder"),
    "load_mass_kg": Range(0.0, 1e6, "a press of 1000 t"),
    "bore_mm": Range(8.0, 1100.0, "ISO 6020 and 6022 have 25 to 500"),
    "rod_mm": Range(4.0, 1000.0, "ISO 6020 and 6022 have 12 to 360"),
    "second_rod_mm": Range(0.0, 1000.0, "as the other rod, 0 for none"),
    "dead_volume_a_cm3": Range(0.05, 1e5, "some percent of the swept volume"),
    "dead_volume_b_cm3": Range(0.05, 1e5, "some percent of the swept volume"),
    "line_a_length_m": Range(0.0, 100.0, "a valve on the cylinder to one across the hall"),
    "line_b_length_m": Range(0.0, 100.0, "a valve on the cylinder to one across the hall"),
    "line_a_inner_mm": Range(2.0, 150.0, "hoses of DN 3 to pipes of DN 125"),
    "line_b_inner_mm": Range(2.0, 150.0, "hoses of DN 3 to pipes of DN 125"),
    "line_a_modulus_mpa": Range(100.0, 2500.0, _HOSE),
    "line_b_modulus_mpa": Range(100.0, 2500.0, _HOSE),
    "line_a_wall_mm": Range(0.5, 30.0, "steel pipes of 1 to 10"),
    "line_b_wall_mm": Range(0.5, 30.0, "steel pipes of 1 to 10"),
    "oil_viscosity_mm2_s": Range(1.0, 5000.0, "water to cold oil; 15 to 100 at work"),
    "breakaway_pressure_bar": Range(0.05, 20.0, "0.5 of low-friction seals to 10 of V-packings"),
    "rated_flow_l_min": Range(0.5, 5000.0, "servo-valves of size 4 to cartridges of size 100"),
    "rated_pressure_drop_bar": Range(1.0, 70.0, "an edge: 5 of proportional, 35 of servo-valves"),
    "spool_stroke_mm": Range(0.2, 30.0, _SPOOL),
    "overlap_percent": Range(0.0, 40.0, "0 of servo-valves, 10 to 25 of proportional valves"),
    "ratio_a_b": Range(0.2, 5.0, "1 of symmetric spools, 2 for cylinders of ratio 2"),
    "flow_at_half_opening_percent": Range(50.0, 90.0, "50 of a linear valve"),
    "frequency_90deg_hz": Range(1.0, 1000.0, "5 Hz of pilots to some 300 Hz of servo-valves"),
    "step_response_ms": Range(0.5, 500.0, "2 of servo-valves to 200 of large pilots"),
    "oil_temperature_c": Range(-20.0, 90.0, "a cold start to the limit of seals"),
    "pump_displacement_cm3": Range(0.1, 1000.0, "a micro pump to a large variable one"),
    "pump_speed_rpm": Range(300.0, 6000.0, "1450 of a motor with four poles"),
    "pump_volumetric_efficiency_percent": Range(50.0, 100.0, "85 to 97 of sound pumps"),
}
"""What data sheets and machines have; beyond it a unit is mistaken more often than not."""

_SPEED = "our choice: polyurethane seals take 0.5 m/s, servo-cylinders 5"
_ACCELERATION = "our choice: machines have some m/s², a hammer's piston 1000 g"
SWING: Final = Range(0.2, 1000.0, "our choice: cranes have 1 Hz, short test cylinders some hundred")

USUAL_RESULTS: Final[Mapping[str, Range]] = {
    "top speed extending": Range(0.0, 5000.0, _SPEED),
    "top speed retracting": Range(0.0, 5000.0, _SPEED),
    "largest acceleration": Range(0.0, 1e4, _ACCELERATION),
    "eigenfrequency, lowest": SWING,
}
"""What machines reach, in the units of the facts (decision 103)."""

_VACUUM = "gauge pressure; a vacuum is -1.01325 bar"

POSSIBLE: Final[Mapping[str, Range]] = {
    "supply_pressure_bar": Range(-1.01325, math.inf, _VACUUM),
    "tank_pressure_bar": Range(-1.01325, math.inf, _VACUUM),
    "cavitation_floor_bar": Range(-1.01325, math.inf, _VACUUM),
    "bulk_modulus_mpa": Range(-math.inf, 443_000.0, "that of diamond"),
    "oil_density_kg_m3": Range(-math.inf, 22_600.0, "that of osmium"),
    "discharge_coefficient": Range(-math.inf, 1.0, "1 is an orifice without any loss"),
}
"""What nature allows, where the plant does not check it; beyond it the configuration is refused."""
