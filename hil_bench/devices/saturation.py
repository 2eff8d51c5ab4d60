"""What an integer object shows for a quantity: the nearest integer that it can hold."""

from typing import Final

_EXACT: Final = 2.0**51
_UNITS_ONLY: Final = 1.5 * 2.0**52  # from here to 2^53 doubles are the whole numbers


def nearest(value: float) -> int:
    """Return what `round` does, the even integer of two that are as near; compiled, in no call."""
    if -_EXACT < value < _EXACT:
        return int(value + _UNITS_ONLY - _UNITS_ONLY)
    return round(value)


def saturate(value: float, lowest: int, highest: int, *, unknown: int) -> int:
    """Return `value` as the nearest integer from `lowest` to `highest`, or `unknown` for NaN."""
    if value <= lowest:
        return lowest
    if value >= highest:
        return highest
    return nearest(value) if value == value else unknown  # noqa: PLR0124 - false for NaN only
