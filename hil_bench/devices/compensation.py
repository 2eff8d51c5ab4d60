"""Compensation of cylinder and spool in the set-point of a CiA 408 valve.

Source: Moog ACV CANopen manual B99224-DV018-D-211, sections 7.2.6 (directional gain), 7.2.7
(characteristic) and 7.2.8 (dead band). Which side is A is not in the part of it that was at hand:
here a positive set-point opens to A.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

CURVE_POINTS: Final = 257
"""Points of a characteristic, from -16384 to 16384."""
_CURVE_STEP: Final = 128
_CURVE_START: Final = -16384


class DeadBandType(IntEnum):
    """Values of 0x6342."""

    OFF = 0
    JUMP = 1
    CONTINUOUS = 2


class DeadBand(NamedTuple):
    """Dead band compensation: the smallest openings are made larger.

    Attributes:
        kind: what happens below the threshold: nothing comes out, or a part of the step.
        side_a: step of a positive set-point [increments].
        side_b: step of a negative set-point, as a positive number [increments].
        threshold: set-point of the step [increments].
        reference: set-point that goes through unchanged, 100 % [increments].
    """

    kind: DeadBandType
    side_a: int
    side_b: int
    threshold: int
    reference: int

    def compensate(self, value: float) -> float:
        """Return the set-point `value` with the step added."""
        if value > 0.0:
            return self._stretch(value, self.side_a)
        return -self._stretch(-value, self.side_b) if value else 0.0

    def _stretch(self, size: float, step: int) -> float:
        if size >= self.reference:
            return size
        if size >= self.threshold:
            slope = (self.reference - step) / (self.reference - self.threshold)
            return step + (size - self.threshold) * slope
        return 0.0 if self.kind is DeadBandType.JUMP else size * step / self.threshold


def follow_curve(value: float, outputs: Sequence[int]) -> float:
    """Return a set-point bent by a characteristic, straight between its points.

    Args:
        value: the set-point [increments].
        outputs: what comes out at -16384, -16256, ..., 16384; the ends hold beyond them.
    """
    place = (value - _CURVE_START) / _CURVE_STEP
    if place <= 0.0:
        return outputs[0]
    if place >= CURVE_POINTS - 1:
        return outputs[-1]
    below = int(place)
    return outputs[below] + (place - below) * (outputs[below + 1] - outputs[below])


def apply_directional_gain(value: float, factor: float) -> float:
    """Return a set-point whose gain is reduced on one side.

    Args:
        value: the set-point [increments].
        factor: gain of the positive side by that of the negative side; the larger gain is 1.
    """
    if factor < 1.0:
        return value * factor if value > 0.0 else value
    return value if value > 0.0 else value / factor
