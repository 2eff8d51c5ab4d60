"""Readers of single values.

A `Reader` takes a value as TOML gave it and returns the checked value, or raises a `ConfigError`
that says what is wrong and what would be right; who calls it adds where.
"""

import json
import math
from collections.abc import Callable, Iterable
from typing import Any

from hil_bench.errors import ConfigError
from hil_bench.units import ONE, UNIT_OF, Unit

Value = Any  # of a type that its reader has checked
Reader = Callable[[object], Value]

_LONGEST = 40  # characters of a bad value that a message repeats
_LARGEST = 2**63 - 1  # integer of TOML
_MOST_BITS = 14_000  # of an integer in decimal: Python refuses to write out those of 4300 digits


def quote(text: str) -> str:
    """Return text in quotes, on one line whatever it holds."""
    return json.dumps(text, ensure_ascii=not text.isprintable())


def describe(value: object) -> str:
    """Return a value as a person would find it in the file, in a few words."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return quote(_shorten(value))
        case int() | float():
            return _shorten(_digits(value))
        case dict():
            return "a table"
        case list():
            return "an array"
        case _:
            return "a date or time"  # TOML knows no other type


def find_nearest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is most like `name`, whatever its case.

    One that differs in its unit alone is the nearest: `offset_bar` for `offset_psi`.
    """
    names = {known_name.lower(): known_name for known_name in known}
    if (wanted := _without_unit(name.lower()))[1]:
        names = {each: names[each] for each in names if _without_unit(each) == wanted} or names
    return names[close_names(name.lower(), sorted(names), cutoff=0.0)[0]]


def _without_unit(name: str) -> tuple[str, str]:
    """Return a name without the unit at its end, and the SI unit of that; both may be empty."""
    units = [each for each in UNIT_OF.values() if each.suffix and name.endswith(each.suffix)]
    unit = max(units, key=lambda each: len(each.suffix), default=ONE)
    return name.removesuffix(unit.suffix), unit.si


def close_names(
    name: str, known: Iterable[str], *, most: int = 1, cutoff: float = 0.6
) -> list[str]:
    """Return the known names that are like `name`, the nearest first.

    Args:
        name: as somebody wrote it.
        known: names.
        most: how many are returned.
        cutoff: likeness that a name must have, up to 1.
    """
    from difflib import get_close_matches  # noqa: PLC0415 - a start without a mistake needs none

    return get_close_matches(name, list(known), n=most, cutoff=cutoff)


class NoNumberError(ConfigError):
    """Something else stands where a number ought to."""


def number(unit: Unit = ONE, *, low: float = -math.inf, high: float = math.inf) -> Reader:
    """Return a reader of finite numbers in `unit`, from `low` to `high` where these are given."""
    right = "give a number" if unit is ONE else f"give a number in {unit.symbol}"
    if low > -math.inf:
        right += f" from {low:g} to {high:g}"

    def read(value: object) -> float:
        found = _finite(value, right)
        if not low <= found <= high:
            raise ConfigError(f"{found:g} is out of range; {right}")
        return found

    return read


def nonzero(value: object) -> float:
    """Return a finite number that is not 0.

    Raises:
        ConfigError: the value is something else.
    """
    right = "give a number other than 0"
    if number := _finite(value, right):
        return number
    raise ConfigError(f"{describe(value)} would lose the quantity; {right}")


def non_negative(value: object) -> float:
    """Return a finite number, 0 or more.

    Raises:
        ConfigError: the value is something else.
    """
    right = "give a number, 0 or more"
    if (number := _finite(value, right)) >= 0.0:
        return number
    raise ConfigError(f"{describe(value)} is out of range; {right}")


def zero_or(read: Reader) -> Reader:
    """Return a reader that takes 0 too, which switches something off."""

    def read_or_zero(value: object) -> Value:
        if isinstance(value, int | float) and not isinstance(value, bool) and value == 0:
            return value
        try:
            return read(value)
        except ConfigError as error:
            raise ConfigError(f"{error}, or 0 for none") from None

    return read_or_zero


def interval(unit: Unit) -> Reader:
    """Return a reader of ``[start, end]`` in `unit`, start below end."""
    right = f"give [start, end] in {unit.symbol}, start below end"

    def read(value: object) -> tuple[float, float]:
        if not isinstance(value, list) or len(value) != 2:
            raise ConfigError(f"{describe(value)} is not a range; {right}")
        start, end = (_finite(bound, right) for bound in value)
        if start >= end:
            raise ConfigError(f"[{start:g}, {end:g}] is empty; {right}")
        return start, end

    return read


def points(unit: Unit) -> Reader:
    """Return a reader of ``[[time, value], ...]`` in the two parts of `unit`."""
    right = f"give [[time, value], ...], each {unit.symbol}"

    def read(value: object) -> tuple[tuple[float, float], ...]:
        if not isinstance(value, list):
            raise ConfigError(f"{describe(value)} is not a list of points; {right}")
        for point in value:
            if not isinstance(point, list) or len(point) != 2:
                raise ConfigError(f"{describe(point)} is not a point; {right}")
        return tuple((_finite(time, right), _finite(number, right)) for time, number in value)

    return read


def integer(low: int, high: int | None = None) -> Reader:
    """Return a reader of integers from `low` to `high`, both included."""
    right = f"give an integer from {low} {'up' if high is None else f'to {high}'}"

    def read(value: object) -> int:
        if not isinstance(value, int) or isinstance(value, bool):
            raise ConfigError(f"{describe(value)} is not an integer; {right}")
        if high is None and value > _LARGEST:
            wrong = f"{describe(value)} is out of range"
            raise ConfigError(f"{wrong}; give an integer from {low} to {_LARGEST}")
        if value < low or (high is not None and value > high):
            raise ConfigError(f"{describe(value)} is out of range; {right}")
        return value

    return read


class choice:  # noqa: N801 - reads like the functions beside it
    """A reader of words.

    Args:
        words: to choose from, which may be the values of an enumeration.

    Attributes:
        words: as passed in.
    """

    def __init__(self, words: Iterable[str]) -> None:
        self.words = tuple(words)

    def __call__(self, value: object) -> str:
        """Return the word that a value is.

        Raises:
            ConfigError: it is another one.
        """
        for word in self.words:
            if word == value:
                return word
        known = ", ".join(f'"{word}"' for word in self.words)
        raise ConfigError(f"{describe(value)} is unknown; give one of {known}")


def boolean(value: object) -> bool:
    """Return a truth value.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, bool):
        raise ConfigError(f"{describe(value)} is not a truth value; give true or false")
    return value


def text(value: object) -> str:
    """Return text that is not empty, and may be a path.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{describe(value)} is not a name; give text in quotes")
    return _without_nul(value)


def as_table(value: object, right: str) -> dict[str, Any]:
    """Return a table, where a key has one as its value.

    Args:
        value: as TOML gave it.
        right: how it is to be written.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, dict):
        raise ConfigError(f"{describe(value)} is not a table; {right}")
    return value


def texts(value: object) -> tuple[str, ...]:
    """Return a list of texts.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, list) or not all(isinstance(each, str) and each for each in value):
        raise ConfigError(f'{describe(value)} is not a list of texts; write it as ["A", "B"]')
    return tuple(map(_without_nul, value))


def _without_nul(value: str) -> str:
    if "\0" in value:
        raise ConfigError(f"{describe(value)} has a NUL character, which no name and no path has")
    return value


def _finite(value: object, right: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise NoNumberError(f"{describe(value)} is not a number; {right}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ConfigError(f"{describe(value)} is not finite; {right}")
    return number


def _digits(value: float) -> str:
    return hex(value) if isinstance(value, int) and value.bit_length() > _MOST_BITS else str(value)


def _shorten(text: str) -> str:
    """Return a text without its middle where it is long: names of a kind differ at their ends."""
    half = (_LONGEST - 3) // 2
    return text if len(text) <= _LONGEST else f"{text[:half]}...{text[-half:]}"
