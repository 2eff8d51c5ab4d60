"""Friction of the piston: the Stribeck curve, eq. (13), and bristles that bend before it slides."""

import math

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


# The LuGre model of friction: bristles that bend before the piston slides.
#
#     dz_f/dt = v - lambda z_f,   lambda = sigma_0 |v| / g(v)
#     f = sigma_0 z_f + sigma_1 dz_f/dt + sigma v
#
# with g(v) the level of the Stribeck curve, eq. (13) without its viscous part. At constant
# velocity z_f settles at g(v) sign(v) / sigma_0, and f at eq. (13) as printed, with the true
# sign (Astrom and Canudas-de-Wit, Revisiting the LuGre model, IEEE Control Systems Magazine
# 28(6), 2008).


BristleConstants = tuple[float, float]
"""(sigma_0, sigma_1); sigma_0 is 0 where the static curve holds."""

Bending = tuple[float, float, float]
"""(decay, reach, lag): z_f after a step is decay z_f + reach v, its mean reach/dt z_f + lag v."""

# Below this the closed form of the lag cancels; the series' next term is then below 1e-11.
_SLOW = 1e-2


@kernel
def slip_rate(v: float, friction: FrictionConstants, bristles: BristleConstants) -> float:
    """Return lambda, the rate at which bristles slip at velocity v [1/s]."""
    speed = abs(v)
    F_c = friction[0]
    stribeck, _ = weaken(CREEP if speed < CREEP else speed, friction)
    return bristles[0] * speed / (F_c + stribeck)


@kernel
def bend(rate: float, dt: float) -> Bending:
    """Return the bristles' motion over a step, exact for a constant velocity.

    Args:
        rate: lambda [1/s].
        dt: step [s].
    """
    r = rate * dt
    if r < _SLOW:
        lag = dt * (0.5 - r * (1.0 / 6.0 - r * (1.0 / 24.0 - r / 120.0)))
        return math.exp(-r), dt - r * lag, lag
    reach = -math.expm1(-r) / rate
    return math.exp(-r), reach, (1.0 - reach / dt) / rate


@kernel
def resist(
    z_f: float, bending: Bending, sigma: float, dt: float, bristles: BristleConstants
) -> tuple[float, float]:
    """Return the mean friction over a step as force at v = 0 [N] and as slope over v [N s/m].

    Args:
        z_f: bristle deflection at the start of the step [m].
        bending: of the bristles over the step.
        sigma: viscous friction coefficient [N s/m].
        dt: step [s].
        bristles: the constants.
    """
    sigma_0, sigma_1 = bristles
    decay, reach, lag = bending
    held = (sigma_0 * reach - sigma_1 * (1.0 - decay)) / dt * z_f
    return held, sigma_0 * lag + sigma_1 * reach / dt + sigma


@kernel
def settle(z_f: float, v: float, bending: Bending, limit: float) -> float:
    """Return the bristle deflection one step later [m], never beyond F_s / sigma_0.

    Args:
        z_f: bristle deflection [m].
        v: mean velocity over the step [m/s].
        bending: of the bristles over the step.
        limit: F_s / sigma_0 [m].
    """
    decay, reach, _ = bending
    z_f = decay * z_f + reach * v
    return limit if z_f > limit else -limit if z_f < -limit else z_f
