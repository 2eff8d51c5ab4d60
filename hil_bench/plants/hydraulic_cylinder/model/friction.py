"""Friction of the piston: the Stribeck curve, eq. (13), with tanh(gain v) for the sign."""

from hil_bench.plants.hydraulic_cylinder.model.elementary import exp, log, tanh
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

FrictionConstants = tuple[float, float, float, float, float, float]
"""(F_c, F_s - F_c, sigma, log(chi), delta, tanh gain)."""

# Below this speed the secant is taken as constant: its limit at rest is finite, 0 / 0 is not.
CREEP = 1e-12

# exp(-exp(7)) is 0 in double precision: beyond that, nothing is left of the Stribeck effect.
_WEAKENED = 7.0


@kernel
def weaken(speed: float, friction: FrictionConstants) -> tuple[float, float]:
    """Return the Stribeck part of eq. (13) and the power in its exponent, for a speed above 0.

    Returns:
        (F_s - F_c) exp(-power) [N] and power = (speed / chi)^delta [-].
    """
    _, weakening, _, log_chi, delta, _ = friction
    exponent = delta * (log(speed) - log_chi)
    power = exp(_WEAKENED if exponent > _WEAKENED else exponent)
    return weakening * exp(-power), power


@kernel
def linearise_friction(v: float, friction: FrictionConstants) -> tuple[float, float]:
    """Return secant f / v and tangent df / dv of the friction curve at velocity v [N s/m].

    f(v) = tanh(gain v) (F_c + (F_s - F_c) exp(-|v / chi|^delta)) + sigma v, eq. (13).
    """
    F_c, _, sigma, _, delta, gain = friction
    speed = abs(v)
    speed = CREEP if speed < CREEP else speed
    stribeck, power = weaken(speed, friction)
    level = F_c + stribeck
    sign = tanh(gain * speed)
    sign_secant = sign / speed
    rise = gain * (1.0 - sign * sign) * level if sign < 1.0 else 0.0
    fall = sign_secant * stribeck * power * delta
    return sign_secant * level + sigma, rise - fall + sigma


@kernel
def friction_force(v: float, friction: FrictionConstants) -> float:
    """Return the friction force [N] at velocity v [m/s], positive against motion, eq. (13)."""
    return v * linearise_friction(v, friction)[0]
