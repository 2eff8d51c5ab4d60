"""Edits of a file, as a person makes them, drawn from the keys that the code itself reads.

`Schema` listens while a verb reads a file: each table with each `Key`, its reader and its range.
So a new key, table, kind or dialect is edited without anybody writing it here.
"""

import copy
import functools
import inspect
import math
import string
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import strategies as st

from hil_bench.config import settings
from hil_bench.config.settings import Key

Path = tuple[str | int, ...]

WORDS = ("axis1", "valve", "pressure_a", "position", "P_A", "bus", "bar", "mm")
HOSTILE = (
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0, -1, 2**31, 2**64, 10**400),
    *(True, "", " ", "NaN", "1 bar", "-5 mm", "1e999 kN", "\x1b[2J", "a\nb", "\u202e", "é\x7f"),
    *(*WORDS, "../none", "always", [], {}, [[]], [1], ["x", "x"], {"a": {}}),
)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
ANYTHING = st.sampled_from(HOSTILE) | TEXT
"""Values of TOML, few of which any key takes."""


class Schema:
    """The keys of each table that was read last, by the name of the table as messages have it."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, Key]] = {}

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Note each key that is read meanwhile."""
        read = settings._read_key
        heard: dict[str, dict[str, Key]] = {}

        def noted(table: str, given: object, key: Key, problems: object) -> object:
            heard.setdefault(table, {})[key.name] = key
            return read(table, given, key, problems)  # type: ignore[arg-type]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(settings, "_read_key", noted)
            yield
        self.tables |= heard


def _once_a_key(make: Callable[[Key], Any]) -> Callable[[Key], Any]:
    """Keep what is made of each key; some cannot be hashed, since their default is a table."""
    made: dict[int, tuple[Key, Any]] = {}

    @functools.wraps(make)
    def get(key: Key) -> Any:
        if id(key) not in made:
            made[id(key)] = key, make(key)
        return made[id(key)][1]

    return get


@_once_a_key
def sound_values(key: Key) -> list[object]:
    """Return values that the reader of a key takes: example, default, edges, words of its own."""
    bound = _bound(key.read)
    low, high = bound.get("low"), bound.get("high")
    found: list[Any] = [*_parsed(key.example), *map(str, bound.get("choices") or ())]
    if isinstance(key.default, float | int) and not isinstance(key.default, bool):
        found += [key.default, *(key.default * share for share in (0.5, 0.9, 1.1, 2.0))]
    elif key.default is not None:
        found.append(str(key.default))
    found += [each for each in (low, high) if each is not None and abs(each) < 1e6]
    anything = [True, False, 0, 1, 2, 0.5, 10.0, *WORDS, [0.0, 1.0], [[0.0, 1.0]]]
    return [each for each in found if _is_taken(key, each)] or [
        each for each in anything if _is_taken(key, each)
    ]


def edge_values(key: Key) -> list[object]:
    """Return values at and just beyond the range of a key."""
    bound = _bound(key.read)
    edges = [each for each in (bound.get("low"), bound.get("high")) if each is not None]
    beside = [each + d for each in edges if isinstance(each, int) for d in (-1, 1)]
    return [*edges, *beside, *(math.nextafter(each, s) for each in edges for s in (-1e9, 1e9))]


@_once_a_key
def values_of(key: Key) -> st.SearchStrategy[Any]:
    """Values for a key: sound ones, any of its range, those beside its ends, and anything."""
    bound = _bound(key.read)
    low, high = bound.get("low"), bound.get("high")
    sound, edges = sound_values(key), edge_values(key)
    parts: list[st.SearchStrategy[Any]] = [st.sampled_from(sound)] * 3 if sound else []
    if isinstance(low, int) and isinstance(high, int):
        parts.append(st.integers(low, high))
    elif low is not None and high is not None and low < high:
        parts.append(st.floats(low, high))
    return st.one_of(*parts, *[st.sampled_from(edges)] * bool(edges), ANYTHING)


def _bound(read: Any) -> dict[str, Any]:
    """Return what a reader holds, and what the reader in it holds."""
    if not inspect.isfunction(read):
        return {}
    found = dict(inspect.getclosurevars(read).nonlocals)
    return found | (_bound(found["read"]) if "read" in found else {})


def _parsed(example: str) -> Iterator[object]:
    try:
        yield tomllib.loads(f"x = {example.split(', or', maxsplit=1)[0]}")["x"]
    except tomllib.TOMLDecodeError:
        return


def _is_taken(key: Key, value: object) -> bool:
    try:
        key.read(value)
    except Exception:
        return False
    return True


@st.composite
def document_edits(draw: st.DrawFn, document: dict[str, Any], schema: Schema) -> dict[str, Any]:
    """A document after one edit; most leave a sound file sound."""
    document = copy.deepcopy(document)
    place, table = draw(st.sampled_from([*_tables(document)]))
    known = schema.tables.get(_name(place), {})
    sort = draw(st.integers(0, 19))
    if sort < 10 and table:
        name = draw(st.sampled_from([*table]))
        table[name] = _nudge(draw, table[name], known.get(name))
    elif sort < 15 and known:
        key = known[draw(st.sampled_from([*known]))]
        table[key.name] = draw(values_of(key))
    elif sort < 17 and table:
        _spoil(draw, table)
    elif sort < 18:
        table[draw(TEXT)] = draw(ANYTHING)
    else:
        _duplicate(draw, document)
    return document


def _nudge(draw: st.DrawFn, value: Any, key: Key | None) -> Any:
    """Return a value near another one, or a known word in place of another."""
    match value:
        case bool() | int():
            more = draw(st.sampled_from((-1, 1, 2, 10)))
            return not value if isinstance(value, bool) else max(min(value, 0), value + more)
        case float():
            return value * draw(st.sampled_from((0.5, 0.9, 0.99, 1.01, 1.1, 2.0, -1.0)))
        case str() if key is not None and (values := sound_values(key)):
            return draw(st.sampled_from(values))
        case list() if value:
            at = draw(st.integers(0, len(value) - 1))
            return [*value[:at], _nudge(draw, value[at], None), *value[at + 1 :]]
        case dict() if value:
            name = draw(st.sampled_from([*value]))
            return {**value, name: _nudge(draw, value[name], None)}
        case _:
            return value


def _spoil(draw: st.DrawFn, table: dict[str, Any]) -> None:
    name = draw(st.sampled_from([*table]))
    match draw(st.integers(0, 3)):
        case 0:
            del table[name]
        case 1:
            table[name[:-1] + draw(st.sampled_from("_ax "))] = table.pop(name)
        case 2:
            table[name] = draw(ANYTHING)
        case _:
            for _ in range(draw(st.integers(1, 40))):
                table[name] = {"x": table[name]}


def _duplicate(draw: st.DrawFn, document: dict[str, Any]) -> None:
    """Copy a table beside itself."""
    name = draw(st.sampled_from([*document] or [""]))
    match document.get(name):
        case list() as tables if tables:
            tables.append(copy.deepcopy(draw(st.sampled_from(tables))))
        case dict() as tables if tables:
            old = draw(st.sampled_from([*tables]))
            tables[old + draw(st.sampled_from(["2", "_", "é", " "]))] = copy.deepcopy(tables[old])
        case _:
            document[draw(st.sampled_from(WORDS))] = {}


def _tables(value: Any, place: Path = ()) -> Iterator[tuple[Path, dict[str, Any]]]:
    if isinstance(value, dict):
        yield place, value
    pairs = value.items() if isinstance(value, dict) else enumerate(value, 1)
    for name, each in pairs:
        if isinstance(each, dict | list):
            yield from _tables(each, (*place, name))


def _name(place: Path) -> str:
    text = ""
    for each in place:
        text += f"[{each}]" if isinstance(each, int) else f".{each}"
    return text.removeprefix(".")


@st.composite
def cell_edits(draw: st.DrawFn, text: str) -> str:
    """A table of cells after one edit."""
    rows = [line.split(",") for line in text.split("\n")]
    row = draw(st.integers(0, len(rows) - 1))
    cell = draw(st.integers(0, len(rows[row]) - 1))
    match draw(st.integers(0, 8)):
        case 0 if len(rows) > 1:
            del rows[row]
        case 1:
            rows.insert(row, [*rows[row]])
        case 2:
            del rows[row][cell]
        case 3:
            rows[row].insert(cell, rows[row][cell])
        case 4:
            rows[row][cell] = str(draw(ANYTHING))
        case _:
            others = [each for line in rows[:8] for each in line]
            values = [*others, "0", "0.5", "1", "-1", "nan", "1e308"]
            rows[row][cell] = draw(st.sampled_from(values))
    return "\n".join(",".join(line) for line in rows)


@st.composite
def line_edits(draw: st.DrawFn, text: str) -> str:
    """Lines after one edit of a line, or of a digit in it."""
    lines = text.split("\n")
    at = draw(st.integers(0, len(lines) - 1))
    line = lines[at]
    where = draw(st.integers(0, len(line)))
    match draw(st.integers(0, 11)):
        case 0 if len(lines) > 1:
            del lines[at]
        case 1:
            lines.insert(at, draw(st.sampled_from(lines)))
        case 2:
            lines[at] = str(draw(ANYTHING))
        case 3:
            lines[at] = line[:where]
        case 4:
            lines[at] = line[:where] + draw(TEXT) + line[where:]
        case 5 if "=" in line:
            lines[at] = f"{line.partition('=')[0]}={draw(ANYTHING)}"
        case _ if digits := [n for n, letter in enumerate(line) if letter in string.hexdigits]:
            place = draw(st.sampled_from(digits))
            lines[at] = line[:place] + draw(st.sampled_from("0123456789ABCDEF")) + line[place + 1 :]
    return "\n".join(lines)


@st.composite
def byte_edits(draw: st.DrawFn, content: bytes) -> bytes:
    """A file after one edit: cut off, flipped bits, other lengths, parts twice or lost."""
    at = draw(st.integers(0, max(0, len(content) - 1)))
    end = min(len(content), at + draw(st.sampled_from((1, 2, 4, 8, 16, 64, 256))))
    match draw(st.integers(0, 7)):
        case 0:
            return content[:at]
        case 1:
            return content[:at] + content[end:]
        case 2:
            return content[:end] + content[at:end] * draw(st.integers(1, 100)) + content[end:]
        case 3:
            return content[:at] + draw(st.binary(max_size=16)) + content[end:]
        case 4 | 5:
            flipped = content[at] ^ 1 << draw(st.integers(0, 7)) if content else 0
            return content[:at] + bytes((flipped,)) + content[at + 1 :]
        case _:
            size = draw(st.sampled_from((1, 2, 4, 8)))
            word = draw(st.sampled_from(_NUMBERS)) & (1 << 8 * size) - 1
            order = draw(st.sampled_from(("little", "big")))
            return content[:at] + word.to_bytes(size, order) + content[at + size :]
