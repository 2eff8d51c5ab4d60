"""The controller and the motion of the demo, to fit valve, cylinder and load."""

import math

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency
from hil_bench.plants.hydraulic_cylinder.summary import damping_ratio, softest_position
from hil_drivers import ControllerParameters, MotionProfile

_GAIN_SHARE = 0.2  # of the gain at which the loop becomes unstable
_LOWEST_DAMPING = 0.05  # which an axis has in motion, by the open edges of its valve
_SPEED, _SPEED_SHARE = 0.15, 0.6  # highest speed [m/s], and as a share of what the axis can
_LOWEST_SPEED = 0.01  # of an axis that its load holds [m/s]
_ACCELERATION = 1.5  # highest [m/s²]
_SWING_SHARE = 0.25  # of the speed that the axis may gain in a radian of its swing


def tuned_parameters(axis: CylinderConfig) -> ControllerParameters:
    """Return a controller that fits an axis.

    The gain is a fifth of where the loop becomes unstable, 2 D ω of the piston with its load on the
    oil (eqs. (18) to (20)) or of the spool, where that is slower. The speed at full opening is that
    of the reduced model without load, eqs. (14), (16), or what a compensator lets pass.
    """
    p = axis.parameters
    x = softest_position(p)
    damping = max(damping_ratio(axis, x), _LOWEST_DAMPING)
    of_piston = 2.0 * damping * math.tau * eigenfrequency(axis, x)
    drop = 0.5 * (p.P_S - p.P_T)
    full_speed = p.alpha * p.K * drop**0.5 / p.mean_area
    for extends in (True, False):
        motion = steady_motion(p, axis.options, extends=extends)
        if motion.is_compensated:
            full_speed = min(full_speed, motion.speed)
    return ControllerParameters(
        position_gain=_GAIN_SHARE * min(of_piston, 2.0 * p.xi * p.omega_0),
        full_speed=full_speed,
        dead_zone=p.beta / p.full_opening,
    )


def demo_profile(start: float, axis: CylinderConfig) -> MotionProfile:
    """Return moves of different lengths within half of the stroke, for ever.

    Args:
        start: where the piston is [m].
        axis: which moves as fast as it can follow, without swinging on its oil.
    """
    p = axis.parameters
    top = min(steady_motion(p, axis.options, extends=each).speed for each in (True, False))
    speed = max(min(_SPEED, _SPEED_SHARE * top), _LOWEST_SPEED)
    gentle = _SWING_SHARE * speed * math.tau * eigenfrequency(axis, softest_position(p))
    return MotionProfile(
        start,
        [share * p.h for share in (0.4, -0.3, 0.1, 0.5, 0.0)],
        speed=speed,
        acceleration=min(_ACCELERATION, gentle),
        dwell=0.4,
        repeat=True,
    )
