"""exp, log and tanh by arithmetic alone, for the friction curve.

Against the C library's: as fast in a single plant, the same bits with every libm, and no call that
would keep the compiler from stepping many plants at once (`model.batch`). A few
operations on the bits of a float have a compiled and an interpreted form; both are exact.
"""

import math
from typing import TYPE_CHECKING

from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, kernel

if TYPE_CHECKING:
    import numpy as np  # noqa: TC004 - who compiles a kernel puts it here

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238  # its last 21 bits are 0, so its product with an exponent is exact
_LN2_LOW = 1.9082149292705877e-10
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: a sum with it has no fraction left
_ROOT_HALF = math.sqrt(0.5)
_ROOT_HALF_BITS = 0x3FE6A09E667F3BCD
_BIAS, _FRACTION_BITS = 1023, 52
_LEAST_EXPONENT = -700.0  # exp of it is 1e-304, still a normal number

# 1 / n!, for the Taylor series of exp
_3, _4, _5, _6, _7 = 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040
_8, _9, _10, _11, _12 = 1 / 40320, 1 / 362880, 1 / 3628800, 1 / 39916800, 1 / 479001600

if IS_COMPILED:

    @kernel
    def power_of_two(rounded: float) -> float:
        """Return 2 to the power of what `_ROUNDER` was added to."""
        bits = np.float64(rounded).view(np.int64)
        power: float = np.int64((bits + _BIAS) << _FRACTION_BITS).view(np.float64)
        return power

    @kernel
    def split(x: float) -> tuple[float, float]:
        """Return m and k of x = m 2^k, x > 0, with m from sqrt(1/2) to sqrt(2)."""
        bits = np.float64(x).view(np.int64)
        k = (bits - _ROOT_HALF_BITS) >> _FRACTION_BITS
        m: float = np.int64(bits - (k << _FRACTION_BITS)).view(np.float64)
        return m, float(k)

else:

    def power_of_two(rounded: float) -> float:
        """Return 2 to the power of what `_ROUNDER` was added to."""
        if math.isnan(rounded):  # a plant that has diverged
            return math.nan
        return math.ldexp(1.0, int(rounded - _ROUNDER))

    def split(x: float) -> tuple[float, float]:
        """Return m and k of x = m 2^k, x > 0, with m from sqrt(1/2) to sqrt(2)."""
        m, k = math.frexp(x)
        return (2.0 * m, k - 1.0) if m < _ROOT_HALF else (m, float(k))


@kernel
def reduce_exp(x: float) -> tuple[float, float]:
    """Return q and s of exp(x) = s (1 + q), with s a power of two, for x from -708 to 709.

    q is exp(r) - 1 for |r| <= log(2) / 2, by its Taylor series up to r^12; what is left out is
    below r^13 / 13! exp(r) = 2.4e-16.
    """
    rounded = x * _LOG2_E + _ROUNDER
    k = rounded - _ROUNDER
    r = x - k * _LN2_HIGH - k * _LN2_LOW
    r_2 = r * r
    r_4 = r_2 * r_2
    low = (0.5 + r * _3) + r_2 * (_4 + r * _5)
    high = (_6 + r * _7) + r_2 * (_8 + r * _9) + r_4 * ((_10 + r * _11) + r_2 * _12)
    return r + r_2 * (low + r_4 * high), power_of_two(rounded)


@kernel
def exp(x: float) -> float:
    """Return the exponential of x, up to 709; below -700 that of -700, 1e-304."""
    q, s = reduce_exp(_LEAST_EXPONENT if x < _LEAST_EXPONENT else x)
    return s + s * q


@kernel
def tanh(x: float) -> float:
    """Return the hyperbolic tangent of x >= 0, as accurate near 0 as elsewhere."""
    q, s = reduce_exp(40.0 if x > 20.0 else 2.0 * x)
    excess = s * q + (s - 1.0)
    return excess / (excess + 2.0)


@kernel
def log(x: float) -> float:
    """Return the natural logarithm of a normal number x > 0.

    log(m) = 2 f (1 + f²/3 + f⁴/5 + ... + f²⁰/21), f = (m - 1) / (m + 1); with |f| < 0.1716 what is
    left out is below 1e-18.
    """
    m, k = split(x)
    f = (m - 1.0) / (m + 1.0)
    g = f * f
    g_2 = g * g
    g_4 = g_2 * g_2
    low = (1 / 3 + g * (1 / 5)) + g_2 * (1 / 7 + g * (1 / 9))
    high = (1 / 11 + g * (1 / 13)) + g_2 * (1 / 15 + g * (1 / 17))
    rest = g * (low + g_4 * (high + g_4 * (1 / 19 + g * (1 / 21))))
    return k * _LN2_HIGH + (2.0 * f + (2.0 * f * rest + k * _LN2_LOW))
