"""Motion profiles of a drive's demand: ramps to a velocity, a trapezoid to a position.

Units are increments, increments a second and a second squared.
"""

import math

_ROUNDING = 1e-9


class Motion:
    """The demand position and velocity of one axis.

    Attributes:
        position: demand [increments].
        velocity: demand [increments/s].
    """

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0

    def restart(self, position: float, velocity: float) -> None:
        """Begin where the axis is."""
        self.position, self.velocity = position, velocity

    def ramp_to(self, velocity: float, acceleration: float, deceleration: float, dt: float) -> None:
        """Move on by `dt` [s] towards a velocity."""
        is_faster = abs(velocity) > abs(self.velocity) and velocity * self.velocity >= 0.0
        step = (acceleration if is_faster else deceleration) * dt
        change = min(max(velocity - self.velocity, -step), step)
        self.velocity += change
        self.position += self.velocity * dt

    def move_to(
        self,
        target: float,
        fastest: float,
        acceleration: float,
        deceleration: float,
        dt: float,
    ) -> bool:
        """Move on by `dt` [s] towards a position; return whether it is reached."""
        way = target - self.position
        if abs(way) <= deceleration * dt * dt + _ROUNDING and abs(self.velocity) <= (
            2.0 * deceleration * dt + _ROUNDING
        ):
            self.restart(target, 0.0)
            return True
        # The velocity from which the way is left to brake, one step ahead.
        half = 0.5 * deceleration * dt
        allowed = math.sqrt(half * half + 2.0 * deceleration * abs(way)) - half
        wanted = math.copysign(min(allowed, fastest), way)
        self.ramp_to(wanted, acceleration, deceleration, dt)
        return False

    def follow(self, target: float, velocity: float, dt: float) -> None:
        """Move on by `dt` [s] at a velocity, no further than a target."""
        way = target - self.position
        step = velocity * dt
        if abs(step) >= abs(way) or step * way <= 0.0:
            self.restart(target, way / dt if dt else 0.0)
            return
        self.position += step
        self.velocity = velocity
