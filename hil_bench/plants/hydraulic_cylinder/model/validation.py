"""Refusals of numbers that make no physical sense, in one wording."""

import math

from hil_bench.errors import ParameterError

SMALLEST = 1e-15
LARGEST = 1e15


def require_number(symbol: str, value: float, unit: str) -> None:
    """Refuse what is not an integer or a float.

    Raises:
        ParameterError: when `value` is of another type; a bool counts as one.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(f"{symbol} = {value!r}: must be a number{_in(unit)}")


def require_finite(symbol: str, value: float, unit: str) -> None:
    """Refuse what is not a finite number of sane size.

    Raises:
        ParameterError: when `value` is no number, NaN, infinite or beyond 1e15 in size.
    """
    require_number(symbol, value, unit)
    if not math.isfinite(value) or abs(value) > LARGEST:
        raise ParameterError(
            f"{symbol} = {value:g}{_unit(unit)}: must be finite and no larger than {LARGEST:g}"
        )


def require_positive(symbol: str, value: float, unit: str) -> None:
    """Refuse what is not a finite number above zero.

    Raises:
        ParameterError: as `require_finite`, and when `value` is below 1e-15.
    """
    require_finite(symbol, value, unit)
    if value < SMALLEST:
        raise ParameterError(f"{symbol} = {value:g}{_unit(unit)}: must be greater than 0")


def require_not_negative(symbol: str, value: float, unit: str) -> None:
    """Refuse what is not a finite number of zero or more.

    Raises:
        ParameterError: as `require_finite`, and when `value` is below zero.
    """
    require_finite(symbol, value, unit)
    if value < 0.0:
        raise ParameterError(f"{symbol} = {value:g}{_unit(unit)}: must be 0 or greater")


def require_count(symbol: str, value: int) -> None:
    """Refuse what is not a whole number of zero or more.

    Raises:
        ParameterError: when `value` is no integer, or negative.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        raise ParameterError(f"{symbol} = {value!r}: must be an integer")
    if value < 0:
        raise ParameterError(f"{symbol} = {value}: must be 0 or greater")


def require_kind(symbol: str, value: object, *kinds: type) -> None:
    """Refuse what is of no right type.

    Raises:
        ParameterError: when `value` is not an instance of one of `kinds`.
    """
    if not isinstance(value, kinds):
        names = " or ".join(kind.__name__ for kind in kinds).replace("NoneType", "None")
        raise ParameterError(f"{symbol} = {value!r}: must be {names}")


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""
