"""The controller and the motion of the demo, to fit valve, cylinder and load."""

import math
from dataclasses import replace

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, require_cylinder
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.quantities import POSITION
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency
from hil_bench.plants.hydraulic_cylinder.summary import damping_ratio, softest_position
from hil_bench.plants.kind import AxisConfig
from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.plants.rotary.quantities import ANGLE
from hil_drivers import ControllerParameters, MotionProfile

_GAIN_SHARE = 0.2  # of the gain at which the loop becomes unstable
_LOWEST_DAMPING = 0.05  # which an axis has in motion, by the open edges of its valve
_SPEED, _SPEED_SHARE = 0.15, 0.6  # highest speed [m/s], and as a share of what the axis can
_LOWEST_SPEED = 0.01  # of an axis that its load holds [m/s]
_ACCELERATION = 1.5  # highest [m/s²]
_SWING_SHARE = 0.25  # of the speed that the axis may gain in a radian of its swing


_SHAFT_SPEED = 20.0 * math.pi  # highest speed [rad/s]
_SHAFT_SPAN = 60.0 * math.pi  # in place of the half-stroke [rad]
_SHAFT_TOLERANCE = 2e-3  # left alone at rest [rad]
_MOVES = (0.4, -0.3, 0.1, 0.5, 0.0)


class DemoAxis:
    """The axis that the demo moves, and its motion.

    Args:
        axis: a cylinder or a motor; `ConfigError` for another plant.

    Attributes:
        quantity: what is controlled: position [m] or angle [rad].
        turns: whether it is a motor.
    """

    def __init__(self, axis: AxisConfig) -> None:
        self.turns = isinstance(axis, RotaryConfig)
        self.quantity = ANGLE if self.turns else POSITION
        if isinstance(axis, RotaryConfig):
            self._cylinder, self._lever = axis.cylinder, axis.lever
        else:
            self._cylinder, self._lever = require_cylinder(axis, "the demo"), 1.0

    def parameters(self) -> ControllerParameters:
        """Return a controller that fits the axis."""
        found = tuned_parameters(self._cylinder)
        if not self.turns:
            return found
        return replace(found, full_speed=found.full_speed / self._lever, tolerance=_SHAFT_TOLERANCE)

    def profile(self, start: float) -> MotionProfile:
        """Return moves of different lengths, for ever, from where the axis is [m, rad]."""
        if not self.turns:
            return demo_profile(start, self._cylinder)
        p, lever = self._cylinder.parameters, self._lever
        motions = (steady_motion(p, self._cylinder.options, extends=each) for each in (True, False))
        top = min(motion.speed for motion in motions) / lever
        speed = max(min(_SHAFT_SPEED, _SPEED_SHARE * top), _LOWEST_SPEED / lever)
        return MotionProfile(
            start,
            [start + share * _SHAFT_SPAN for share in _MOVES],
            speed=speed,
            acceleration=_SWING_SHARE * speed * math.tau * eigenfrequency(self._cylinder, 0.0),
            dwell=0.4,
            repeat=True,
        )


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
        [share * p.h for share in _MOVES],
        speed=speed,
        acceleration=min(_ACCELERATION, gentle),
        dwell=0.4,
        repeat=True,
    )
