"""Oil and piston over an implicit step, with the swing of one on the other to fourth order.

The midpoint rule shows the swing of the piston on the oil (omega dt)² / 12 too slow. So both take
the end correction of the trapezoidal rule for the part of the motion that is this swing,

    dx = dt (v + dv / 2) - dt² / 12 (change of acceleration),   likewise for dv,

with the change of acceleration that pressures and viscous friction make. In the linear system that
stays symmetric: it takes 1 / (12 inertia) A A' from the oil's rows and puts sigma / (12 inertia) on
the half (`docs/decisions/0042-a-step-in-parts.md`).
"""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil, Response
from hil_bench.plants.hydraulic_cylinder.model.chamber import ChamberConstants
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants
from hil_bench.plants.hydraulic_cylinder.model.friction import FrictionConstants
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

_TWELFTH = 1.0 / 12.0


@kernel
def swing_lag(v: float, inertia: float, friction: FrictionConstants) -> float:
    """Return the end correction's share of a force in the mean velocity [m/(N s)].

    It is 0 where friction may hold the piston, with a secant above m / dt: there is no swing.

    Args:
        v: velocity at the start of the step [m/s].
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    strength = friction[0] + friction[1]
    if strength * friction[5] > inertia and strength > inertia * abs(v):
        return 0.0
    return _TWELFTH / inertia


@kernel
def couple(rows: Oil, lag: float, sigma: float, chambers: ChamberConstants) -> Oil:
    """Return the oil of a step with the end correction, from that of the midpoint rule.

    Args:
        rows: of the midpoint rule, with 1/2 as `half`.
        lag: as `swing_lag` gives it.
        sigma: viscous friction coefficient [N s/m].
        chambers: the constants.
    """
    a, b, c, net_A, net_B, half = rows
    _, _, A_A, A_B, _, _, _ = chambers
    return (
        a - lag * A_A * A_A,
        b - lag * A_B * A_B,
        c - lag * A_A * A_B,
        net_A,
        net_B,
        half + lag * sigma,
    )


@kernel
def eliminate_pressures(oil: Oil, chambers: ChamberConstants) -> Response:
    """Return both pressures' response to the step's velocity change, with no cavity at its end.

    Args:
        oil: of the step.
        chambers: the constants.
    """
    a, b, c, net_A, net_B, half = oil
    _, _, A_A, A_B, _, _, _ = chambers
    per_det = 1.0 / (a * b - c * c)
    return (
        (b * net_A + c * net_B) * per_det,
        half * (b * A_A - c * A_B) * per_det,
        (c * net_A + a * net_B) * per_det,
        half * (c * A_A - a * A_B) * per_det,
    )


@kernel
def pressure_rises(response: Response, dv: float) -> tuple[float, float]:
    """Return by how much both pressures rise over a step with this velocity change [Pa]."""
    dP_A, fall_A, dP_B, fall_B = response
    return dP_A - fall_A * dv, dP_B - fall_B * dv


@kernel
def velocity_change(
    force: float, inertia: float, half: float, response: Response, constants: Constants
) -> tuple[float, float]:
    """Return the velocity change over the step [m/s] and the force it takes [N s/m].

    Args:
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston [N s/m].
        half: of the step's oil.
        response: of the pressures.
        constants: in their groups.
    """
    (_, _, A_A, A_B, _, _, _), (_, _, sigma, _, _, _) = constants[5], constants[6]
    dP_A, fall_A, dP_B, fall_B = response
    swing = (half - _TWELFTH / half) * (A_A * fall_A - A_B * fall_B)
    resistance = inertia + (half - 0.5) * sigma + swing
    return (force + half * (A_A * dP_A - A_B * dP_B)) / resistance, resistance


@kernel
def mean_velocity(
    v: float,
    dv: float,
    rises: tuple[float, float],
    half: float,
    lag: float,
    chambers: ChamberConstants,
) -> float:
    """Return the mean velocity over the step [m/s].

    Args:
        v: velocity at the start of the step [m/s].
        dv: velocity change over the step [m/s].
        rises: of P_A and P_B over the step [Pa].
        half: of the step's oil.
        lag: as `couple` was given it.
        chambers: the constants.
    """
    swing = chambers[2] * rises[0] - chambers[3] * rises[1]
    return v + half * dv - lag * swing
