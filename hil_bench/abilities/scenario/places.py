"""The place of a key in a file: line and column, which the TOML parser does not give."""

import re
from collections.abc import Mapping
from typing import NamedTuple

from hil_bench.config.settings import Problems, quote_name

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*("[^"]*"|'[^']*'|[\w-]+(?:\.[\w-]+)*)\s*=\s*""")
_QUOTES = ('"""', "'''")


class Spot(NamedTuple):
    """A line and a column, both from 1."""

    line: int
    column: int


Spots = Mapping[tuple[str, str], Spot]
"""Of the value of each key, by table and key."""


class LocatedProblems(Problems):
    """Problems whose places begin with file, line and column.

    Args:
        source: the file.
        spots: where its keys stand.
    """

    def __init__(self, source: str, spots: Spots) -> None:
        super().__init__(source)
        self.spots = spots

    def place(self, table: str, key: str = "") -> str:
        """Return file, line, column and name of a key; of its table where the key is missing."""
        name = ".".join(quote_name(part) for part in (table, key) if part)
        spot = self.find(table, key)
        where = f"{self.source}:{spot.line}:{spot.column}" if spot else self.source
        return f"{where}: {name}" if name else where

    def find(self, table: str, key: str) -> Spot | None:
        """Return the place of a key, else of the part around it; None where it is unknown."""
        parent, _, name = table.rpartition(".")
        for wanted in ((table, key), (table, ""), (parent, name), ("", table)):
            if wanted in self.spots:
                return self.spots[wanted]
        return None


def find_spots(text: str) -> Spots:
    """Return the places of all keys and tables of a TOML text."""
    spots: dict[tuple[str, str], Spot] = {}
    counts: dict[str, int] = {}
    table, quotes = "", ""
    for number, line in enumerate(text.splitlines(), 1):
        if quotes:
            quotes = "" if quotes in line else quotes
        elif header := _HEADER.match(line):
            table = _name(header[2], counts) if header[1] == "[[" else header[2]
            spots[table, ""] = Spot(number, header.start(2) + 1)
        elif key := _KEY.match(line):
            name = key[1].strip("\"'")
            spots.setdefault((table, name), _value_spot(number, key.end(), line))
            quotes = _open_quotes(line[key.end() :])
    return spots


def _name(table: str, counts: dict[str, int]) -> str:
    counts[table] = counts.get(table, 0) + 1
    return f"{table}[{counts[table]}]"


def _value_spot(number: int, start: int, line: str) -> Spot:
    """Return the place of a value's text: behind its quotes."""
    rest = line[start:]
    for quotes in (*_QUOTES, '"', "'"):
        if rest.startswith(quotes):
            start += len(quotes)
            return Spot(number + 1, 1) if start == len(line) else Spot(number, start + 1)
    return Spot(number, start + 1)


def _open_quotes(rest: str) -> str:
    for quotes in _QUOTES:
        if rest.count(quotes) % 2:
            return quotes
    return ""
