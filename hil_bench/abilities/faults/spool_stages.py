"""Effects of defects on the set-point of a spool."""

from hil_bench.abilities.faults.effects import Growth


class Bound:
    """A silted spool: it moves once its set-point is off by a band, and then all the way.

    Args:
        band: how far the set-point must be off [m], which grows.
        position: where the spool is at first [m].
    """

    def __init__(self, band: Growth, position: float) -> None:
        self._band, self._position = band, position

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        if abs(setpoint - self._position) > self._band.next():
            self._position = setpoint
        return self._position


class Weak:
    """Solenoids without their full force: the spool goes no further than a share of its stroke.

    Args:
        loss: share of the stroke that is lost, which grows.
        full: spool position of 100 % [m].
    """

    def __init__(self, loss: Growth, full: float) -> None:
        self._loss, self._full = loss, full

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        reach = self._full * (1.0 - self._loss.next())
        return min(max(setpoint, -reach), reach)
