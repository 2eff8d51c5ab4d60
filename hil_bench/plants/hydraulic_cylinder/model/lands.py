"""The four metering edges of a spool: a gain of their own each, and a flow that saturates."""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.spool import OpeningConstants

LandConstants = tuple[float, float, float, float, float]
"""(gains of P-A, A-T, P-B and B-T, saturation s) [-]."""


@kernel
def meter_openings(
    z: float, opening: OpeningConstants, lands: LandConstants
) -> tuple[float, float]:
    """Return the openings of the ports A and B at an orifice state [m], signed as for `port_flow`.

    With a = |z| / alpha the flow follows a sqrt((1 + s) / (1 + s a²)): linear for s = 0, and for
    a large s soon as much as it will be. It is the law z / sqrt(1 + (z / z_s)²) with
    s = (alpha / z_s)², scaled to the same flow of the wide open valve.

    Args:
        z: orifice state [m].
        opening: the constants of eq. (2).
        lands: the constants.
    """
    P_A, A_T, P_B, B_T, s = lands
    share = z / (opening[0] if z > 0.0 else opening[2])
    bent = z * math.sqrt((1.0 + s) / (1.0 + s * share * share))
    if z > 0.0:
        return bent * P_A, -(bent * B_T)
    return bent * A_T, -(bent * P_B)
