"""Tables of keys: what a table may hold, and where each of its values came from."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NamedTuple

from hil_bench.config import values
from hil_bench.config.values import Reader, Value, describe, find_nearest, quote
from hil_bench.errors import ConfigError
from hil_bench.units import MICROSECOND, MILLISECOND, ONE, UNIT_OF, Unit

CLOCK_MICROSECOND = MICROSECOND._replace(factor=1000)
CLOCK_MILLISECOND = MILLISECOND._replace(factor=1_000_000)
"""Of keys whose record counts ns, as the clock of a bench does."""

_PLAIN_NAME = re.compile(r"[A-Za-z0-9_.\[\]-]+")


class Origin(StrEnum):
    """The origin of a value, the weakest first."""

    DEFAULT = "default"
    DATA_SHEET = "data sheet"
    FILE = "file"
    ENVIRONMENT = "environment"
    COMMAND_LINE = "command line"


class Range(NamedTuple):
    """A range of a key, in the key's own unit.

    Attributes:
        low: the least.
        high: the largest.
        reason: whose range it is.
    """

    low: float
    high: float
    reason: str


class Key(NamedTuple):
    """One key of a table.

    Attributes:
        name: the key, which ends in its unit's suffix.
        read: the reader that checks its value.
        default: the value where nobody gives one.
        unit: its unit.
        field: the attribute of the record that it fills, where that has another name.
        example: a value for the message about a missing key; only a key that must be given has one.
        usual: what data sheets and machines have; beyond it a value is doubted.
        possible: what nature allows; beyond it a value is refused.
        accepts: values that a record accepts, as `rows` has it; empty for each finite number.
        group: of the keys that belong together.
        sheet: the data sheet that has the key, or determines it.
    """

    name: str
    read: Reader
    default: Value = None
    unit: Unit = ONE
    field: str = ""
    example: str = ""
    usual: Range | None = None
    possible: Range | None = None
    accepts: str = ""
    group: str = ""
    sheet: str = ""


class Setting(NamedTuple):
    """One value as a person writes it, and where it came from.

    Attributes:
        table: the table, as in ``plant.axis1``.
        key: the key in that table.
        value: the value in the key's own unit; None where python-can is left to decide.
        origin: who gave the value.
        reason: what it follows from, where it follows from other keys.
    """

    table: str
    key: Key
    value: Value
    origin: Origin
    reason: str = ""


Settings = dict[str, Setting]  # by the name of the key


class Given(NamedTuple):
    """A value that somebody gave, not yet checked.

    Attributes:
        value: the value as it came.
        origin: who gave it.
        place: how a message names the place where it stands.
    """

    value: object
    origin: Origin
    place: str


class Problems:
    """The problems of one configuration, told together, one line each.

    Attributes:
        source: how messages name the file.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._lines: list[str] = []

    def place(self, table: str, key: str = "") -> str:
        """Return the place of a key for messages; TOML allows any text as table and key."""
        return f"{self.source}:{'.'.join(quote_name(name) for name in (table, key) if name)}"

    def add(self, place: str, what: object) -> None:
        """Note problems, one a line; `what` says what is wrong and what would be right."""
        self._lines += [f"{place}: {line}" for line in str(what).splitlines()]

    @property
    def has_any(self) -> bool:
        """Return True if there is a problem."""
        return bool(self._lines)

    def raise_any(self) -> None:
        """End the loading if there is a problem.

        Raises:
            ConfigError: all problems so far, one line each.
        """
        if self._lines:
            raise ConfigError("\n".join(self._lines))


def quote_name(name: str) -> str:
    """Return the name of a table or key as a message shows it."""
    return name if _PLAIN_NAME.fullmatch(name) else quote(name)


def give(
    table: str, values: Mapping[str, object], origin: Origin, problems: Problems
) -> dict[str, Given]:
    """Return `values` with their place in `table`; what has one already keeps it."""
    return {
        key: value if isinstance(value, Given) else Given(value, origin, problems.place(table, key))
        for key, value in values.items()
    }


def open_table(table: str, given: Given, problems: Problems) -> dict[str, Given]:
    """Return the keys and values of a table; what is no table is noted, and counts as empty."""
    if isinstance(given.value, dict):
        return give(table, given.value, given.origin, problems)
    problems.add(given.place, f"{describe(given.value)} is not a table; write it as [{table}]")
    return {}


def read_table(
    table: str, values: Mapping[str, object], keys: Sequence[Key], problems: Problems
) -> Settings:
    """Return the settings of a table by key; one with a problem is noted and left out.

    Args:
        table: its name.
        values: what stands there, each as TOML has it or as a `Given`.
        keys: that it may have.
        problems: where problems are noted.
    """
    given = give(table, values, Origin.FILE, problems)
    known = [key.name for key in keys]
    for name in given:
        if name not in known:
            nearest = find_nearest(name, known)
            problems.add(given[name].place, f"unknown key; the nearest known key is {nearest}")
    settings = (_read_key(table, given.get(key.name), key, problems) for key in keys)
    return {setting.key.name: setting for setting in settings if setting is not None}


def convert(settings: Settings, keys: Sequence[Key]) -> dict[str, Any]:
    """Return the SI values of some keys, by the attribute of the record that each one fills."""
    return {key.field or key.name: _to_si(settings[key.name].value, key.unit) for key in keys}


def _read_key(table: str, given: Given | None, key: Key, problems: Problems) -> Setting | None:
    if given is None and key.example:
        place = problems.place(table, key.name)
        problems.add(place, f"missing; give for example {key.name} = {key.example}")
        return None
    if given is None:
        return Setting(table, key, key.default, Origin.DEFAULT)
    try:
        value = key.read(given.value)
    except ConfigError as error:
        problems.add(given.place, error)
        return None
    return Setting(table, key, value, given.origin)


def _to_si(value: Value, unit: Unit) -> Value:
    if isinstance(value, tuple):
        return tuple(_to_si(part, unit) for part in value)
    return unit.to_si(value) if type(value) in {int, float} else value


# Parameters as the rows of a table: one row declares one key.
#
# The columns of the file are separated by tabs; those without example, range or sheet lack it:
#
# - `group`: the keys that belong together, as those of one record do;
# - `key`, `unit`, `default`, `field`, `example`: as of a `Key`; a default that is left out is None;
# - `accepts`: what is read, ``low..high`` in the key's unit, ``whole low..high``, ``0 or`` one of
#   them, ``interval``, ``points``, ``true or false``, ``text``, or ``a word``, whose reader
#   `with_words` gets; or what the record accepts: ``> 0``, ``>= 0``, or ``none,`` and that;
# - `usual`, `usually`, `possible`, `naturally`: the ranges of a `Key`, and the reason of each;
# - `symbol`, `absent`, `meaning`: of the documents: symbol in the equations, what holds where there
#   is no default, and one line of help;
# - `sheet`: the data sheet that has the key, or that determines it.


HALF_MILLIMETRE: Final = Unit("mm", "_mm", 0.5e-3)
"""Of a length of which a model has the half."""

_UNITS: Final = {**UNIT_OF, "mm/2": HALF_MILLIMETRE, "us in ns": CLOCK_MICROSECOND}


class Rows(NamedTuple):
    """The keys of a table of parameters.

    Attributes:
        keys: in the order of the file.
        groups: those that belong together, by the name of their group.
    """

    keys: tuple[Key, ...]
    groups: Mapping[str, tuple[Key, ...]]

    def sheet(self, name: str) -> tuple[Key, ...]:
        """Return the keys that a data sheet has."""
        return tuple(key for key in self.groups["sheet"] if key.sheet == name)


def with_words(keys: Iterable[Key], words: Mapping[str, values.Reader]) -> Iterator[Key]:
    """Yield keys in which those of words have their readers."""
    for key in keys:
        read = words.get(key.name)
        yield key._replace(read=read, default=key.default and read(key.default)) if read else key


def read_rows(path: Path) -> Rows:
    """Return the keys that a file declares."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    names = head.split("\t")
    return group(_key(dict(zip(names, line.split("\t"), strict=True))) for line in lines)


def group(keys: Iterable[Key]) -> Rows:
    """Return keys with their groups."""
    groups: dict[str, list[Key]] = {}
    every = tuple(keys)
    for key in every:
        groups.setdefault(key.group, []).append(key)
    return Rows(every, {name: tuple(group) for name, group in groups.items()})


def _key(row: Mapping[str, str]) -> Key:
    unit, accepts = _UNITS[row["unit"]], row["accepts"]
    return Key(
        row["key"],
        _reader(unit, accepts),
        _default(row["default"], accepts),
        unit,
        row["field"],
        row.get("example", ""),
        usual=_range(row.get("usual", ""), row.get("usually", "")),
        possible=_range(row.get("possible", ""), row.get("naturally", "")),
        accepts=accepts if accepts.startswith((">", "none")) else "",
        group=row["group"],
        sheet=row.get("sheet", ""),
    )


def _default(default: str, accepts: str) -> values.Value:
    match accepts:
        case "points":
            return ()
        case "a word" | "text":
            return default or None
        case "true or false":
            return default == "true"
        case _ if "whole" in accepts:
            return int(default) if default else None
        case _:
            return float(default) if default else None


def _reader(unit: Unit, accepts: str) -> values.Reader:
    if accepts.startswith("0 or "):
        return values.zero_or(_reader(unit, accepts.removeprefix("0 or ")))
    if accepts.startswith("whole "):
        first, _, last = accepts.removeprefix("whole ").partition("..")
        return values.integer(int(first), int(last) if last else None)
    if ".." in accepts:
        low, high = _limits(accepts)
        return values.number(unit, low=low, high=high)
    plain = {"text": values.text, "a word": values.text, "true or false": values.boolean}.get(
        accepts
    )
    of_unit = {"points": values.points, "interval": values.interval}.get(accepts, values.number)
    return plain or of_unit(unit)


def _range(limits: str, reason: str) -> Range | None:
    return Range(*_limits(limits), reason) if limits else None


def _limits(text: str) -> tuple[float, float]:
    low, _, high = text.partition("..")
    return float(low or -math.inf), float(high or math.inf)
