"""The valve's spool: closed-loop dynamics, eqs. (1), (3); dead-zone and saturation, (2), (4)."""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

SpoolTransition = tuple[float, float, float, float, float]
"""(a_11, a_12, a_21, a_22) of the state (nu - u, nu_dot) over one step with constant u, and the
error [m] from which on the spool is driven no harder."""

SpoolConstants = tuple[float, float, float]
"""(omega_0², 2 xi omega_0, error [m] from which on the spool is driven no harder)."""

OpeningConstants = tuple[float, float, float, float]
"""(alpha, beta) for a positive spool position, then (alpha, beta) for a negative one."""


def spool_reach(omega_0: float, xi: float, speed: float | None) -> float:
    """Return the error u - nu [m] at which eq. (3) drives the spool at a speed [m/s] for good."""
    return math.inf if speed is None else 2.0 * xi * speed / omega_0


def spool_transition(
    omega_0: float, xi: float, dt: float, speed: float | None = None
) -> SpoolTransition:
    """Return the exact transition of eq. (3) over one step with constant set-point.

    The matrix exponential of [[0, 1], [-omega_0², -2 xi omega_0]] dt in closed form, for every
    damping ratio.

    Args:
        omega_0: eigenfrequency [rad/s].
        xi: damping ratio [-].
        dt: step [s].
        speed: of the spool at most [m/s]; None for no limit.
    """
    angle = omega_0 * dt
    even, odd = _decaying_pair(angle, xi)
    return (
        even + xi * angle * odd,
        dt * odd,
        -omega_0 * angle * odd,
        even - xi * angle * odd,
        spool_reach(omega_0, xi, speed) + 0.5 * dt * (speed or 0.0),
    )


def _decaying_pair(angle: float, xi: float) -> tuple[float, float]:
    """Return exp(-xi angle) times cos(mu) and sin(mu) / mu, with mu = angle sqrt(1 - xi²)."""
    mu = angle * math.sqrt(abs(1.0 - xi * xi))
    decay = math.exp(-xi * angle)
    if mu < 1e-6:  # the series' next term is below rounding
        return decay, decay
    if xi < 1.0:
        return decay * math.cos(mu), decay * math.sin(mu) / mu
    # angle (xi - root) = angle / (xi + root): no cancellation, and no cosh to overflow
    slow = math.exp(-angle * angle / (xi * angle + mu))
    fast = math.exp(-xi * angle - mu)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / mu


@kernel
def move_spool(
    nu: float, nu_dot: float, u: float, transition: SpoolTransition
) -> tuple[float, float]:
    """Return spool position [m] and velocity [m/s] one step later, exact for constant u, eq. (3).

    A spool whose speed is limited sees a set-point that is no farther off than its reach, in the
    middle of the step.

    Args:
        nu: spool position [m].
        nu_dot: spool velocity [m/s].
        u: set-point [m].
        transition: as `spool_transition` gives it.
    """
    a_11, a_12, a_21, a_22, reach = transition
    error = nu - u
    if error > reach:
        error, u = reach, nu - reach
    elif error < -reach:
        error, u = -reach, nu + reach
    return u + a_11 * error + a_12 * nu_dot, a_21 * error + a_22 * nu_dot


@kernel
def drive_spool(nu: float, nu_dot: float, u: float, spool: SpoolConstants) -> float:
    """Return the acceleration of the spool [m/s²], eq. (3), with its speed limited.

    Args:
        nu: spool position [m].
        nu_dot: spool velocity [m/s].
        u: set-point [m].
        spool: the constants.
    """
    error, reach = u - nu, spool[2]
    error = reach if error > reach else error
    error = -reach if error < -reach else error
    return spool[0] * error - spool[1] * nu_dot


@kernel
def orifice_state(nu: float, opening: OpeningConstants) -> float:
    """Return the orifice state z [m] at spool position nu [m]: dead-zone, saturation, eq. (2).

    Both are given for each direction, as the paper suggests for "more specific DCV assemblies".
    """
    alpha, beta, alpha_negative, beta_negative = opening
    limit = alpha if nu > 0.0 else alpha_negative
    z = abs(nu) - (beta if nu > 0.0 else beta_negative)
    z = 0.0 if z < 0.0 else z
    z = limit if z > limit else z
    return z if nu > 0.0 else 0.0 - z


# The four metering edges of a spool: a gain of their own each, and a flow that saturates.

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
