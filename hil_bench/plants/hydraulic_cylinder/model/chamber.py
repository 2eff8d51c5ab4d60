"""The cylinder's chambers: volumes, eqs. (10), (11), and continuity, eqs. (8), (9)."""

import math

from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

ChamberConstants = tuple[float, float, float, float, float, float, float]
"""(E, C_L, A_A, A_B, V_A0, V_B0, h)."""


@kernel
def chamber_volumes(x: float, chambers: ChamberConstants) -> tuple[float, float]:
    """Return V_A and V_B [m³] at piston position x [m], held beyond the half-stroke, (10), (11)."""
    _, _, A_A, A_B, V_A0, V_B0, h = chambers
    if x > h:
        x = h
    elif x < -h:
        x = -h
    return V_A0 + A_A * x, V_B0 - A_B * x


@kernel
def net_flows(
    Q_A: float, Q_B: float, v: float, leak: float, chambers: ChamberConstants
) -> tuple[float, float]:
    """Return the flows that compress the oil in A and in B [m³/s]: brackets of eqs. (8), (9).

    Args:
        Q_A: flow through port A [m³/s].
        Q_B: flow through port B [m³/s].
        v: piston velocity [m/s].
        leak: leakage from A to B, C_L (P_A - P_B) [m³/s].
        chambers: the constants.
    """
    _, _, A_A, A_B, _, _, _ = chambers
    return Q_A - A_A * v - leak, Q_B + A_B * v + leak


# The bulk modulus of oil with entrained air.

AirConstants = tuple[float, float]
"""(volume of air over that of oil at atmospheric pressure, polytropic exponent n)."""

# Below this absolute pressure the gas is taken as no softer: it keeps E above zero at vacuum.
_THINNEST = 1000.0


@kernel
def bulk_modulus(pressure: float, E: float, air: AirConstants) -> float:
    """Return the effective bulk modulus of oil with air in it [Pa].

    E_eff = E (1 + r) / (1 + r E / (n p)) with r = ratio (p_atm / p)^(1/n), p the absolute pressure:
    -V dp/dV of oil of modulus E beside gas that follows p V^n = const (the mixture law of
    Simscape's block Hydraulic Fluid). It tends to E at high pressure and to n p at a low one.
    The air neither dissolves nor leaves.

    Args:
        pressure: of the mixture, gauge [Pa].
        E: bulk modulus of the oil without air [Pa].
        air: the constants.
    """
    ratio, n = air
    if ratio == 0.0:
        return E
    p = pressure + ATMOSPHERE
    p = _THINNEST if p < _THINNEST else p
    r = ratio * math.exp(math.log(ATMOSPHERE / p) / n)
    return E * (1.0 + r) / (1.0 + r * E / (n * p))
