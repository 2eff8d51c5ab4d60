"""Edits of a file, as a person makes them, drawn from the keys that the code itself reads.

`Schema` listens while a verb reads a file: each table with each `Key`, its reader and its range.
So a new key, table, kind or dialect is edited without anybody writing it here.
"""

import inspect
import math
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import strategies as st

from hil_bench.config import settings
from hil_bench.config.settings import Key

Draw = Any
Path = tuple[str | int, ...]

HOSTILE = st.sampled_from(
    [
        *(math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0, -1, 2**31, 2**64, 10**400),
        *(True, "", " ", "NaN", "1 bar", "-5 mm", "1e999 kN", "\x1b[2J", "a\nb", "\u202e", "é\x7f"),
        *("axis1", "valve", "axis1.P_A", "../none", "always", [], {}, [[]], [1], ["x", "x"]),
        {"a": {}},
    ]
) | st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
WORDS = ("axis1", "valve", "pressure_a", "position", "P_A", "bus", "bar", "mm")


class Schema:
    """The keys of each table that has been read, by the name of the table as messages have it."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, Key]] = {}

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Note each key that is read meanwhile."""
        read = settings._read_key

        def noted(table: str, given: object, key: Key, problems: object) -> object:
            self.tables.setdefault(table, {})[key.name] = key
            return read(table, given, key, problems)  # type: ignore[arg-type]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(settings, "_read_key", noted)
            yield


def sound_values(key: Key) -> list[object]:
    """Return values that the reader of a key takes: example, default, edges, words of its own."""
    bound = _bound(key.read)
    low, high = bound.get("low"), bound.get("high")
    found: list[Any] = [True, False, 0, 1, 2, 0.5, 10.0, *WORDS, [0.0, 1.0], [[0.0, 1.0]]]
    if key.example:
        found += [*_parsed(key.example)]
    if isinstance(key.default, float | int) and not isinstance(key.default, bool):
        found += [key.default, *(key.default * share for share in (0.5, 0.9, 1.1, 2.0))]
    elif key.default is not None:
        found.append(str(key.default))
    found += [each for each in (low, high) if each is not None and abs(each) < 1e6]
    found += [str(each) for each in bound.get("choices") or ()]
    return [each for each in found if _is_taken(key, each)] or [0]


def edge_values(key: Key) -> list[object]:
    """Return values at and just beyond the range of a key."""
    bound = _bound(key.read)
    edges = [each for each in (bound.get("low"), bound.get("high")) if each is not None]
    beside = [each + d for each in edges if isinstance(each, int) for d in (-1, 1)]
    return [*edges, *beside, *(math.nextafter(each, s) for each in edges for s in (-1e9, 1e9))]


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
def edit(draw: Draw, document: dict[str, Any], schema: Schema) -> None:
    """Change a document by one edit; most leave a sound file sound."""
    tables = [*_tables(document)]
    place, table = draw(st.sampled_from(tables))
    known = schema.tables.get(_name(place), {})
    sort = draw(st.integers(0, 19))
    if known and sort < 14:
        key = known[draw(st.sampled_from(sorted(known)))]
        values = sound_values(key) if sort < 11 else edge_values(key) or [-1]
        table[key.name] = draw(st.sampled_from(values))
    elif sort < 15 and known:
        table[draw(st.sampled_from(sorted(known)))] = draw(HOSTILE)
    elif sort < 17 and table:
        _spoil(draw, table)
    elif sort < 18:
        table[draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=6))] = draw(HOSTILE)
    else:
        _duplicate(draw, document)


def _spoil(draw: Draw, table: dict[str, Any]) -> None:
    name = draw(st.sampled_from(sorted(table)))
    match draw(st.integers(0, 3)):
        case 0:
            del table[name]
        case 1:
            table[name[:-1] + draw(st.sampled_from("_ax "))] = table.pop(name)
        case 2:
            table[name] = draw(HOSTILE)
        case _:
            for _ in range(draw(st.integers(1, 40))):
                table[name] = {"x": table[name]}


def _duplicate(draw: Draw, document: dict[str, Any]) -> None:
    """Copy a table beside itself."""
    name = draw(st.sampled_from(sorted(document) or [""]))
    match document.get(name):
        case list() as tables if tables:
            each = draw(st.sampled_from(tables))
            tables.append(dict(each) if isinstance(each, dict) else each)
        case dict() as tables if tables:
            old = draw(st.sampled_from(sorted(tables)))
            tables[old + draw(st.sampled_from(["2", "_", "é", " "]))] = tables[old]
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
def edit_cells(draw: Draw, text: str) -> str:
    """Return a table of cells after one edit."""
    rows = [line.split(",") for line in text.split("\n")]
    row = draw(st.integers(0, len(rows) - 1))
    cell = draw(st.integers(0, len(rows[row]) - 1))
    match draw(st.integers(0, 8)):
        case 0:
            del rows[row]
        case 1:
            rows.insert(row, [*rows[row]])
        case 2:
            del rows[row][cell]
        case 3:
            rows[row].insert(cell, rows[row][cell])
        case 4:
            rows[row][cell] = str(draw(HOSTILE))
        case _:
            others = [each for line in rows[:8] for each in line]
            rows[row][cell] = draw(
                st.sampled_from([*others, "0", "0.5", "1", "-1", "nan", "1e308"])
            )
    return "\n".join(",".join(line) for line in rows)
