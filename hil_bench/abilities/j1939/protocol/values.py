"""The numbers of a J1939 device by name, for those who read and set them."""

import math
from collections.abc import Callable
from typing import NamedTuple


class EcuValue(NamedTuple):
    """A number that a J1939 device has, as its table gives it.

    Attributes:
        read: returns it; NaN where it shows no value.
        unit: symbol of its unit.
        takes: takes another one, from a test; None where the device itself has the say.
        low: the least that it can show.
        high: the largest.
    """

    read: Callable[[], float]
    unit: str
    takes: Callable[[float], None] | None = None
    low: float = -math.inf
    high: float = math.inf
