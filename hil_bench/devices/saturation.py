"""Saturation of integer objects: the nearest integer to a quantity that the object can hold."""

from typing import Final

_EXACT: Final = 2.0**51
_UNITS_ONLY: Final = 1.5 * 2.0**52  # from here to 2^53 doubles are the whole numbers


def nearest(value: float) -> int:
    """Round to the nearest integer, ties to even, as `round` does; compiled without a call."""
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
