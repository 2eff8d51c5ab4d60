"""Everything a stepping kernel needs to know, as one row of floats.

A row crosses from Python into compiled code faster than a record does. `pack` is written once per
plant, `unpack` sorts the row into one tuple per equation group at the start of a call.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.chamber import AirConstants, ChamberConstants
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    ATMOSPHERE,
    CounterbalanceValve,
    Cushion,
    MeteringLands,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import BristleConstants, FrictionConstants
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    LoadConstants,
    LoadSeries,
    MassOnSlope,
    SpringLoad,
    StopConstants,
)
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    CounterbalanceConstants,
    CushionConstants,
    EdgeConstants,
    OrificeConstants,
)
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.spool import (
    LandConstants,
    OpeningConstants,
    SpoolConstants,
    SpoolTransition,
    spool_reach,
    spool_transition,
)
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    FilterConstants,
    PumpConstants,
    SupplyConstants,
)
from hil_bench.plants.hydraulic_cylinder.model.waves import LineConstants, line_constants

StepConstants = tuple[float, float, float, float]
"""(dt [s], m [kg], 1 / (E dt) [1/(Pa s)], lowest chamber pressure [Pa])."""

ORIFICE_P_S = 17
"""Place of P_S in the row of constants."""

ROW = 37
"""Constants in a row."""

Constants = tuple[
    StepConstants,
    SpoolConstants,
    OpeningConstants,
    SpoolTransition,
    OrificeConstants,
    ChamberConstants,
    FrictionConstants,
    StopConstants,
]


def pack(parameters: PlantParameters, options: PlantOptions, dt: float) -> Sequence[float]:
    """Return the constants of a plant stepped by `dt` [s], in the order that `unpack` expects."""
    p = parameters
    stop = options.end_stop
    floor = options.cavitation_floor
    alpha_negative, beta_negative = options.alpha_negative, options.beta_negative
    constants: Constants = (
        (dt, p.m + options.load_mass, 1.0 / (p.E * dt), -math.inf if floor is None else floor),
        (
            p.omega_0**2,
            2.0 * p.xi * p.omega_0,
            spool_reach(p.omega_0, p.xi, options.spool_speed),
        ),
        (
            p.alpha,
            p.beta,
            p.alpha if alpha_negative is None else alpha_negative,
            p.beta if beta_negative is None else beta_negative,
        ),
        spool_transition(p.omega_0, p.xi, dt, options.spool_speed),
        (p.K, p.P_S, p.P_T, options.laminar_transition**2, float(options.signed_root)),
        (p.E, p.C_L, p.A_A, p.A_B, p.V_A0, p.V_B0, p.h),
        (p.F_c, p.F_s - p.F_c, p.sigma, math.log(p.chi), p.delta, options.tanh_gain),
        (math.inf, 0.0, 0.0) if stop is None else (p.h, stop.stiffness, stop.damping),
    )
    return [float(value) for group in constants for value in group]


@kernel
def unpack(row: Floats) -> Constants:
    """Return the constants in their groups."""
    return unpack_lane(row, 0, 1)


@kernel
def unpack_lane(row: Floats, first: int, stride: int) -> Constants:
    """Return the constants of one plant among several, whose first is at `first`, in their groups.

    Args:
        row: of all plants; each constant of all of them, then the next constant.
        first: index of the plant's first constant.
        stride: how many places lie between two constants of a plant.
    """
    f, s = first, stride
    return (
        (row[f], row[f + s], row[f + 2 * s], row[f + 3 * s]),
        (row[f + 4 * s], row[f + 5 * s], row[f + 6 * s]),
        (row[f + 7 * s], row[f + 8 * s], row[f + 9 * s], row[f + 10 * s]),
        (row[f + 11 * s], row[f + 12 * s], row[f + 13 * s], row[f + 14 * s], row[f + 15 * s]),
        (row[f + 16 * s], row[f + 17 * s], row[f + 18 * s], row[f + 19 * s], row[f + 20 * s]),
        (
            row[f + 21 * s],
            row[f + 22 * s],
            row[f + 23 * s],
            row[f + 24 * s],
            row[f + 25 * s],
            row[f + 26 * s],
            row[f + 27 * s],
        ),
        (
            row[f + 28 * s],
            row[f + 29 * s],
            row[f + 30 * s],
            row[f + 31 * s],
            row[f + 32 * s],
            row[f + 33 * s],
        ),
        (row[f + 34 * s], row[f + 35 * s], row[f + 36 * s]),
    )


# Constants of the extended kernels beyond the paper's, and their further states.


CompensatorConstants = tuple[float]
"""Margin of the pressure compensator [Pa]; infinite for none."""

LeakConstants = tuple[float, float]
"""(C_LA, C_LB) [m³/(s Pa)]."""

ExtendedConstants = tuple[
    LeakConstants,
    AirConstants,
    BristleConstants,
    LoadConstants,
    SupplyConstants,
    LandConstants,
    EdgeConstants,
    CompensatorConstants,
    CushionConstants,
    CounterbalanceConstants,
    PumpConstants,
    FilterConstants,
]

# Where the extension begins in the row, after the paper's constants; where lines and load series.
_EXTENSION = ROW
LINES = _EXTENSION + 47
SERIES = LINES + 8

LINE_COMPLIANCE, PUMP_FLOW, RELIEF_PRESSURE, RELIEF_GRADIENT = range(
    _EXTENSION + 9, _EXTENSION + 13
)
"""Places of the supply line, the pump's flow, and the relief valve's setting and gradient."""


class ExtensionState(NamedTuple):
    """The states that the extensions add to the paper's six.

    Attributes:
        t: time, for the load series [s].
        z_f: deflection of the bristles, LuGre friction [m].
        P_S: supply pressure [Pa].
        Y_A: share by which the counterbalance valve at A is open [-].
        Y_B: the same at B.
        Q_P: flow of a pump that swivels [m³/s].
        waves: the lines with their waves under way, as a plant of the same step had them; none for
            lines at rest.
    """

    t: float
    z_f: float
    P_S: float
    Y_A: float = 0.0
    Y_B: float = 0.0
    Q_P: float = 0.0
    waves: tuple[float, ...] = ()


def pack_extended(parameters: PlantParameters, options: PlantOptions, dt: float) -> Sequence[float]:
    """Return the paper's constants, those of the extensions, and the points of the load series."""
    groups: ExtendedConstants = (
        (options.C_LA, options.C_LB),
        (0.0, 1.0) if options.air is None else (options.air.ratio, options.air.air_exponent),
        _bristle_constants(options),
        _load_constants(options),
        supply_constants(options.supply, parameters.E),
        land_constants(options.lands),
        edge_constants(parameters, options),
        (math.inf if options.compensator_margin is None else options.compensator_margin,),
        _cushion_constants(parameters, options),
        _counterbalance_constants(parameters, options.counterbalance),
        pump_constants(options.supply),
        filter_constants(options.supply),
    )
    series = next(
        (load for load in options.loads if isinstance(load, LoadSeries)), LoadSeries((0.0,), (0.0,))
    )
    lines = (line_constants(line, parameters.rho, dt) for line in (options.line_a, options.line_b))
    points = zip(series.times, series.forces, strict=True)
    return [
        *pack(parameters, options, dt),
        *(float(value) for group in groups for value in group),
        *(value for line in lines for value in line),
        *(float(value) for point in points for value in point),
    ]


def _bristle_constants(options: PlantOptions) -> BristleConstants:
    bristles = options.bristles
    return (0.0, 0.0) if bristles is None else (bristles.sigma_0, bristles.sigma_1)


def _load_constants(options: PlantOptions) -> LoadConstants:
    """Return all constant forces and all springs, each as one."""
    force = math.fsum(
        load.load_force if isinstance(load, ConstantLoad) else load.weight
        for load in options.loads
        if isinstance(load, ConstantLoad | MassOnSlope)
    )
    springs = [load for load in options.loads if isinstance(load, SpringLoad)]
    stiffness = math.fsum(spring.spring_stiffness for spring in springs)
    pull = math.fsum(spring.spring_stiffness * spring.spring_rest for spring in springs)
    return force, stiffness, pull / stiffness if springs else 0.0


def supply_constants(unit: SupplyUnit | None, E: float) -> SupplyConstants:
    """Return the constants of the supply unit; all zero for a constant P_S.

    Args:
        unit: it.
        E: bulk modulus of the oil in its line [Pa].
    """
    if unit is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    return (
        unit.line_volume / E,
        unit.pump_flow,
        unit.relief_pressure,
        unit.relief_gradient,
        unit.accumulator_volume,
        unit.precharge_pressure + ATMOSPHERE,
        unit.gas_exponent,
    )


def land_constants(lands: MeteringLands | None) -> LandConstants:
    """Return the constants of the metering edges; None for four like ones."""
    lands = MeteringLands() if lands is None else lands
    return lands.gain_pa, lands.gain_at, lands.gain_pb, lands.gain_bt, lands.saturation


def edge_constants(parameters: PlantParameters, options: PlantOptions) -> EdgeConstants:
    """Return overlaps and travels of the spool, whether or not they are needed."""
    p, lands = parameters, MeteringLands() if options.lands is None else options.lands
    alpha, beta = options.alpha_negative, options.beta_negative
    alpha, beta = p.alpha if alpha is None else alpha, p.beta if beta is None else beta
    overlaps = (
        default if own is None else own
        for own, default in zip(lands.overlaps, (p.beta, beta, beta, p.beta), strict=True)
    )
    P_A, A_T, P_B, B_T = overlaps
    is_on = float(options.has_edges)
    return is_on, lands.null_opening, P_A, A_T, P_B, B_T, p.alpha + p.beta, alpha + beta


def _cushion_constants(parameters: PlantParameters, options: PlantOptions) -> CushionConstants:
    """Return the resistance of a throttle as one of openings: w over its area."""
    w = parameters.w

    def one(cushion: Cushion | None) -> tuple[float, float]:
        return (0.0, 0.0) if cushion is None else (cushion.length, w / cushion.orifice_area)

    return *one(options.cushion_a), *one(options.cushion_b)


def _counterbalance_constants(
    parameters: PlantParameters, valve: CounterbalanceValve | None
) -> CounterbalanceConstants:
    """Return the constants of the counterbalance valves; the first two 0 for none."""
    if valve is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return (
        float(valve.in_line_a),
        float(valve.in_line_b),
        valve.setting,
        valve.pilot_ratio,
        1.0 / valve.span,
        valve.conductance / parameters.K,
        1.0 / valve.time_constant,
    )


def pump_constants(unit: SupplyUnit | None) -> PumpConstants:
    """Return the constants of a pump that swivels; 0 first for one of constant flow."""
    pump = None if unit is None else unit.variable
    if unit is None or pump is None:
        return 0.0, 0.0, 0.0, 0.0
    rate = unit.pump_flow / pump.swivel_time
    return rate, pump.margin, pump.leakage, float(pump.senses_load)


def filter_constants(unit: SupplyUnit | None) -> FilterConstants:
    """Return the constants of a unit's filter; 0 first for none."""
    if unit is None or unit.filter is None:
        return 0.0, math.inf
    return unit.filter.resistance, unit.filter.bypass


@kernel
def unpack_extended(row: Floats) -> ExtendedConstants:
    """Return the constants of the extensions in their groups."""
    return (
        (row[37], row[38]),
        (row[39], row[40]),
        (row[41], row[42]),
        (row[43], row[44], row[45]),
        (row[46], row[47], row[48], row[49], row[50], row[51], row[52]),
        (row[53], row[54], row[55], row[56], row[57]),
        (row[58], row[59], row[60], row[61], row[62], row[63], row[64], row[65]),
        (row[66],),
        (row[67], row[68], row[69], row[70]),
        (row[71], row[72], row[73], row[74], row[75], row[76], row[77]),
        (row[78], row[79], row[80], row[81]),
        (row[82], row[83]),
    )


@kernel
def unpack_lines(row: Floats) -> tuple[LineConstants, LineConstants]:
    """Return the constants of the lines at A and at B."""
    return (row[84], row[85], row[86], row[87]), (row[88], row[89], row[90], row[91])
