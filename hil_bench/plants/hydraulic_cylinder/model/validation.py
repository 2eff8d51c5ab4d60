"""Refusals of numbers that make no physical sense, in one wording."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from hil_bench.config.settings import Key, read_rows
from hil_bench.errors import ParameterError

ROWS: Final = read_rows(Path(__file__).parents[1] / "parameters.tsv")
"""Those that are words have their readers in `keys`."""

SMALLEST = 1e-15
LARGEST = 1e15


def require_number(symbol: str, value: float, unit: str, of: str = "") -> None:
    """Refuse what is not an integer or a float.

    Raises:
        ParameterError: when `value` is of another type; a bool counts as one.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(*_refusal(symbol, of, f"{value!r}: must be a number{_in(unit)}"))


def require_finite(symbol: str, value: float, unit: str, of: str = "") -> None:
    """Refuse what is not a finite number of sane size.

    Raises:
        ParameterError: when `value` is no number, NaN, infinite or beyond 1e15 in size.
    """
    require_number(symbol, value, unit, of)
    if not math.isfinite(value) or abs(value) > LARGEST:
        what = f"must be finite and no larger than {LARGEST:g}"
        raise ParameterError(*_refusal(symbol, of, f"{value:g}{_unit(unit)}: {what}"))


def require_positive(symbol: str, value: float, unit: str, of: str = "") -> None:
    """Refuse what is not a finite number above zero.

    Raises:
        ParameterError: as `require_finite`, and when `value` is below 1e-15.
    """
    require_finite(symbol, value, unit, of)
    if value < SMALLEST:
        raise ParameterError(
            *_refusal(symbol, of, f"{value:g}{_unit(unit)}: must be greater than 0")
        )


def require_not_negative(symbol: str, value: float, unit: str, of: str = "") -> None:
    """Refuse what is not a finite number of zero or more.

    Raises:
        ParameterError: as `require_finite`, and when `value` is below zero.
    """
    require_finite(symbol, value, unit, of)
    if value < 0.0:
        raise ParameterError(*_refusal(symbol, of, f"{value:g}{_unit(unit)}: must be 0 or greater"))


def require_fields(record: object, keys: Iterable[Key], of: str = "") -> None:
    """Refuse the first field of a record that its key does not accept, as the others here do.

    Args:
        record: to check.
        keys: of its fields that are numbers.
        of: whose they are, where a message says so.
    """
    for key in keys:
        value = getattr(record, key.field)
        if type(value) is float and SMALLEST <= value <= LARGEST:
            continue  # each key accepts that
        if value is not None or not key.accepts.startswith("none"):
            _CHECKS[key.accepts.removeprefix("none").lstrip(", ")](
                key.field, value, key.unit.si, of
            )


_CHECKS = {"> 0": require_positive, ">= 0": require_not_negative, "": require_finite}


def require_count(symbol: str, value: int) -> None:
    """Refuse what is not a whole number of zero or more.

    Raises:
        ParameterError: when `value` is no integer, or negative.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        raise ParameterError(f"{symbol} = {value!r}: must be an integer", symbol)
    if value < 0:
        raise ParameterError(f"{symbol} = {value}: must be 0 or greater", symbol)


def require_kind(symbol: str, value: object, *kinds: type, of: str = "") -> None:
    """Refuse what is of no right type.

    Raises:
        ParameterError: when `value` is not an instance of one of `kinds`.
    """
    if not isinstance(value, kinds):
        names = " or ".join(kind.__name__ for kind in kinds).replace("NoneType", "None")
        raise ParameterError(*_refusal(symbol, of, f"{value!r}: must be {names}"))


def _refusal(symbol: str, of: str, what: str) -> tuple[str, ...]:
    """Return the message about a symbol, and what it names.

    Args:
        symbol: that is wrong.
        of: whose it is, where a message says so.
        what: its value, and what would be right.
    """
    if of:
        return f"{symbol} of {of} = {what}", symbol, of
    return f"{symbol} = {what}", symbol


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""
