"""The valve's orifices: flow over pressure drop, eqs. (5)-(7).

Port A sees the orifice state z, port B sees -z: for both, a positive opening joins the chamber to
the supply and a negative one joins it to the tank, which is eqs. (5) and (6) in one.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

OrificeConstants = tuple[float, float, float, float, float]
"""(K, P_S, P_T, p_tr², signed): `signed` is 1.0 for the signed root, 0.0 for the clamped one."""


@kernel
def linearise_flow(
    opening: float, pressure: float, orifice: OrificeConstants
) -> tuple[float, float, float]:
    """Return the flow into a chamber and how it falls with the chamber's pressure.

    Q = opening K dp / (dp² + p_tr²)^(1/4) with dp = P_S - P or P - P_T: the square root of
    eqs. (5), (6) for |dp| well above the laminar transition p_tr, linear well below it.

    Args:
        opening: z for port A, -z for port B [m].
        pressure: of the chamber [Pa].
        orifice: the constants.

    Returns:
        The flow [m³/s], its secant |Q / dp| and its tangent |dQ / dP|, both [m³/(s Pa)].
    """
    K, P_S, P_T, transition_squared, signed = orifice
    drop = P_S - pressure if opening > 0.0 else pressure - P_T
    square = drop * drop
    total = square + transition_squared
    is_blocked = total == 0.0 or (drop < 0.0 and signed == 0.0)
    total = 1.0 if is_blocked else total
    gain = 0.0 if is_blocked else opening * K / math.sqrt(math.sqrt(total))
    secant = abs(gain)
    # + 0.0: a closed orifice passes 0, never -0
    return gain * drop + 0.0, secant, secant * (1.0 - 0.5 * square / total)


@kernel
def port_flow(opening: float, pressure: float, orifice: OrificeConstants) -> float:
    """Return the flow into a chamber [m³/s], eqs. (5), (6); arguments as `linearise_flow`."""
    return linearise_flow(opening, pressure, orifice)[0]
