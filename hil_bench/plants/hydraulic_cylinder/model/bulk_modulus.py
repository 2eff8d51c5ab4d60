"""The bulk modulus of oil with entrained air."""

import math

from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

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
