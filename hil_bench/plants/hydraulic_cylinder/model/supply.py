"""The supply unit: P_S as a state, fed by a pump, limited by a relief valve; and warm oil.

    C_S dP_S/dt = Q_P - G max(P_S - P_R, 0) - Q_S

with the compliance C_S = V_line / E + V_gas / (n p) of line and accumulator.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import EdgeConstants
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

SupplyConstants = tuple[float, float, float, float, float, float, float]
"""(line compliance [m³/Pa], Q_P, P_R, G, gas volume, precharge, exponent); compliance 0: none.

Gas volume and precharge are those of the empty accumulator, the precharge as absolute pressure.
"""


FilterConstants = tuple[float, float]
"""(R [Pa s/m³], drop of the bypass [Pa]) of `Filter`; 0 first: none."""


@kernel
def supply_compliance(P_S: float, supply: SupplyConstants) -> float:
    """Return the compliance C_S of line and accumulator at supply pressure P_S [m³/Pa].

    The gas follows p V^n = const, so its compliance is V / (n p); below the precharge the
    accumulator is empty and the line's oil is alone.
    """
    line, _, _, _, volume, precharge, n = supply
    p = P_S + ATMOSPHERE
    if p <= precharge:
        return line
    return line + volume * math.exp(math.log(precharge / p) / n) / (n * p)


@kernel
def relief_flow(P_S: float, supply: SupplyConstants) -> float:
    """Return the flow through the relief valve [m³/s] at supply pressure P_S [Pa]."""
    above = P_S - supply[2]
    return supply[3] * above if above > 0.0 else 0.0


@kernel
def behind_filter(
    P_S: float, flow: float, supply: SupplyConstants, element: FilterConstants
) -> tuple[SupplyConstants, float]:
    """Return the unit without a filter that charges its line as one with a filter, and D [Pa].

    The pump is at P_S + D(Q) while Q flows into the line. So with the closed bypass the relief
    valve acts on the line as one that opens at P_R - R Q_P and passes G / (1 + G R) for each
    pressure above; with the open one it opens at P_R - P_by and passes G.

    Args:
        P_S: supply pressure in the line [Pa].
        flow: Q_P of the pump [m³/s].
        supply: the constants.
        element: those of the filter.
    """
    line, _, opens_at, gradient, volume, precharge, n = supply
    R, bypass = element
    if R == 0.0:
        return (line, flow, opens_at, gradient, volume, precharge, n), 0.0
    early, softer = opens_at - R * flow, gradient / (1.0 + gradient * R)
    above = P_S - early if P_S > early else 0.0
    drop = R * (flow - softer * above)
    if drop > bypass:
        return (line, flow, opens_at - bypass, gradient, volume, precharge, n), bypass
    return (line, flow, early, softer, volume, precharge, n), drop


# The pump of a supply unit: of constant flow, or one that swivels to hold a pressure.
#
#     dQ_P/dt = Q_max / t_s (P_target - P_S) / margin,   at most Q_max / t_s, 0 <= Q_P <= Q_max
#     P_target = min(P_LS + margin, P_R) of a load-sensing pump,   P_R of a pressure-compensated one
#
# P_LS is the pressure of the port that the spool feeds, and that of the tank where it feeds none.
# In the balance P_S is the margin above it, so the drop over the feeding edge does not depend on
# the load. The control spool moves the swash plate at a speed that follows the error, so the swash
# plate integrates it; the leakage of the pump lets P_S fall when nobody draws.

PumpConstants = tuple[float, float, float, float]
"""(Q_max / t_s [m³/s²], margin [Pa], leakage [m³/(s Pa)], senses the load); 0 first: none.

Without one the flow of the pump is constant.
"""


@kernel
def sensed_pressure(
    nu: float, pressures: tuple[float, float], P_T: float, edges: EdgeConstants
) -> float:
    """Return the load pressure that a load-sensing line shows [Pa].

    Args:
        nu: spool position [m].
        pressures: P_A and P_B [Pa].
        P_T: tank pressure [Pa].
        edges: the constants.
    """
    if nu > edges[2]:
        return pressures[0]
    return pressures[1] if -nu > edges[4] else P_T


@kernel
def swivel(
    flow: float, P_S: float, sensed: float, dt: float, pump: PumpConstants, supply: SupplyConstants
) -> float:
    """Return the flow of a pump [m³/s] after a time dt.

    Args:
        flow: before [m³/s].
        P_S: supply pressure at the pump [Pa].
        sensed: load pressure [Pa].
        dt: time [s].
        pump: the constants.
        supply: the constants; its flow is the largest.
    """
    rate, margin, _, senses = pump
    if rate == 0.0:
        return supply[1]
    target = supply[2]
    if senses != 0.0 and sensed + margin < target:
        target = sensed + margin
    speed = (target - P_S) / margin
    speed = 1.0 if speed > 1.0 else speed
    speed = -1.0 if speed < -1.0 else speed
    flow += dt * rate * speed
    if flow < 0.0:
        return 0.0
    return supply[1] if flow > supply[1] else flow


# The influence of the oil's temperature on the constants of a plant's equations.


class OilNow(NamedTuple):
    """An oil at its temperature.

    Attributes:
        viscosity: kinematic, over that of the parameters.
        density: over that of the parameters; lines with waves keep theirs, with their wave time.
        stiffness: bulk modulus of the pure oil, over that of the parameters.
        pure: that bulk modulus at the temperature of the parameters [Pa].
    """

    viscosity: float = 1.0
    density: float = 1.0
    stiffness: float = 1.0
    pure: float = 1.4e9

    @property
    def dynamic(self) -> float:
        """Dynamic viscosity over that of the parameters."""
        return self.viscosity * self.density

    def modulus(self, E: float) -> float:
        """Return the bulk modulus [Pa] that was E [Pa]: of its compliance the oil's part changes.

        What hoses and air add to 1 / E stays as it is.
        """
        own = min(1.0 / E, 1.0 / self.pure)
        return 1.0 / (1.0 / E + own * (1.0 / self.stiffness - 1.0))


AS_GIVEN: Final = OilNow()
"""The oil of the parameters."""


def warmed(
    parameters: PlantParameters, options: PlantOptions, oil: OilNow
) -> tuple[PlantParameters, PlantOptions]:
    """Return a plant with warmer or colder oil: what leaks, shears, is throttled or compressed.

    Args:
        parameters: of the plant.
        options: of the plant.
        oil: as it is now.
    """
    if oil == AS_GIVEN:
        return parameters, options
    density = 1.0 if options.has_lines else oil.density
    dynamic = oil.viscosity * density
    parameters = replace(
        parameters,
        C_L=parameters.C_L / dynamic,
        sigma=parameters.sigma * dynamic,
        rho=parameters.rho * density,
        E=oil.modulus(parameters.E),
    )
    options = replace(
        options,
        C_LA=options.C_LA / dynamic,
        C_LB=options.C_LB / dynamic,
        line_a=_thin(options.line_a, oil.viscosity),
        line_b=_thin(options.line_b, oil.viscosity),
    )
    return parameters, options


def _thin(line: Line | None, viscosity: float) -> Line | None:
    return None if line is None else replace(line, viscosity=line.viscosity * viscosity)
