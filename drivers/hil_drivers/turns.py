"""An angle over all turns, from an encoder whose position begins again at 0."""


class TurnCounter:
    """Counts on where the position of a rotary encoder begins again.

    Right as long as the shaft turns by less than half of the encoder's range between two values.
    """

    def __init__(self) -> None:
        self._steps: int | None = None

    def count(self, position: int, total: int) -> int:
        """Return the steps since the first position, which counts as it is.

        Args:
            position: of the encoder [steps].
            total: after how many steps it begins again at 0.
        """
        if self._steps is None:
            self._steps = position
        else:
            half = total // 2
            self._steps += (position - self._steps + half) % total - half
        return self._steps

    def restart(self) -> None:
        """Begin anew with the next position."""
        self._steps = None
