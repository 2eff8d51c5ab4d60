"""The stages of the sensing element: hysteresis, and the errors of offset and gain."""

from collections.abc import Sequence


class Hysteresis:
    """Backlash between quantity and element: the play operator.

    Args:
        width: of the loop, from the rising to the falling branch.
    """

    def __init__(self, width: float) -> None:
        self._reach = 0.5 * width
        self._value: float | None = None

    def follow(self, quantity: float) -> float:
        """Return the output of the element; at first it is in the middle of the loop."""
        if self._value is None:
            self._value = quantity
        elif quantity - self._value > self._reach:
            self._value = quantity - self._reach
        elif self._value - quantity > self._reach:
            self._value = quantity + self._reach
        return self._value


class LinearError:
    """Errors of offset and gain that do not change."""

    def __init__(self, offset: float, gain: float) -> None:
        self._offset = offset
        self._factor = 1.0 + gain

    def follow(self, quantity: float) -> float:
        """Return the quantity with both errors."""
        return quantity * self._factor + self._offset


class DriftingError:
    """Errors of offset and gain that grow with the temperature.

    Args:
        offset: at the reference temperature.
        gain: at the reference temperature.
        offset_drift: growth of the offset [1/K].
        gain_drift: growth of the gain [1/K].
        temperature: points of time [s] and temperature above the reference [K], one or more.
        period: time from one call of `follow` to the next [s].
    """

    def __init__(
        self,
        offset: float,
        gain: float,
        *,
        offset_drift: float,
        gain_drift: float,
        temperature: Sequence[tuple[float, float]],
        period: float,
    ) -> None:
        self._offset, self._gain = offset, gain
        self._offset_drift, self._gain_drift = offset_drift, gain_drift
        self._temperature = TemperatureSeries(temperature)
        self._period = period
        self._calls = 0

    def follow(self, quantity: float) -> float:
        """Return the quantity with both errors at the present temperature."""
        warmth = self._temperature.at(self._calls * self._period)
        self._calls += 1
        gain = self._gain + self._gain_drift * warmth
        return quantity + quantity * gain + self._offset + self._offset_drift * warmth


class TemperatureSeries:
    """A temperature over time, for times that do not go back."""

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        self._rest = list(reversed(points))
        self._before = self._after = self._rest[-1]

    def at(self, time: float) -> float:
        """Return the temperature [K] at a time [s]: linear between points, constant beyond."""
        while self._rest and self._rest[-1][0] <= time:
            self._before = self._rest.pop()
            self._after = self._rest[-1] if self._rest else self._before
        start, value = self._before
        end, next_value = self._after
        if time <= start or end <= start:
            return value
        return value + (next_value - value) * ((time - start) / (end - start))
