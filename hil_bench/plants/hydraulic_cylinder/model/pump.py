"""The pump of a supply unit: of constant flow, or one that swivels to hold a pressure.

    dQ_P/dt = Q_max / t_s (P_target - P_S) / margin,   no faster than Q_max / t_s, 0 <= Q_P <= Q_max
    P_target = min(P_LS + margin, P_R) of a load-sensing pump,   P_R of a pressure-compensated one

P_LS is the pressure of the port that the spool feeds, and that of the tank where it feeds none. In
the balance P_S is the margin above it, so the drop over the feeding edge does not depend on the
load. The control spool moves the swash plate at a speed that follows the error, so the swash plate
integrates it; the leakage of the pump lets P_S fall when nobody draws.
"""

from hil_bench.plants.hydraulic_cylinder.model.edges import EdgeConstants
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.supply import SupplyConstants

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
