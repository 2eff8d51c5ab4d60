"""Parameters as the rows of a table: one row declares one key.

The columns of the file are separated by tabs; those without example, range or sheet lack it:

- `group`: the keys that belong together, as those of one record do;
- `key`, `unit`, `default`, `field`, `example`: as of a `Key`; a default that is left out is None;
- `accepts`: what is read, ``low..high`` in the key's unit, ``whole low..high``, ``0 or`` one of
  them, ``interval``, ``points``, ``true or false``, ``text``, or ``a word``, whose reader
  `with_words` gets; or what the record accepts: ``> 0``, ``>= 0``, or ``none,`` and that;
- `usual`, `usually`, `possible`, `naturally`: the ranges of a `Key`, and the reason of each;
- `symbol`, `absent`, `meaning`: of the documents: symbol in the equations, what holds where there
  is no default, and one line of help;
- `sheet`: the data sheet that has the key, or that determines it.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from hil_bench.config import values
from hil_bench.config.settings import CLOCK_MICROSECOND, Key, Range
from hil_bench.units import UNIT_OF, Unit

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
