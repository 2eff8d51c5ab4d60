"""The TOML file: its text to tables, and its tables to values that know where they stand."""

import re
import tomllib
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Final

from hil_bench.config.settings import Given, Origin, Problems
from hil_bench.config.values import describe, find_nearest
from hil_bench.errors import ConfigError, about_file

Document = Mapping[str, object]

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")


class Sort(StrEnum):
    """The kinds of TOML file."""

    BENCH = "a bench"
    SCENARIO = "a scenario"
    CAMPAIGN = "a campaign"
    PLAN = "a commissioning plan"
    NETWORK = "a network list"
    REGISTER_MAP = "a register map"
    LAYOUT = "a layout"


_MARKS: Final = {
    Sort.BENCH: {"plant", "nodes", "j1939"},
    Sort.SCENARIO: {"step", "expect"},
    Sort.CAMPAIGN: {"scenarios"},
    Sort.PLAN: {"plan", "limits"},
    Sort.NETWORK: {"slaves"},
    Sort.REGISTER_MAP: {"coils", "discrete_inputs", "input_registers", "holding_registers"},
    Sort.LAYOUT: {"items"},
}
"""Tables and keys that no other sort of file has."""


_LARGEST = 16 << 20
"""What is read of a file [byte]: no bench has a tenth of it, and a device file never ends."""


_MOST_PARTS = 100
_PART = rb"""(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*"""
_LONG_KEY = re.compile(rb"(?<![\w-])" + _PART + rb"(?:\.[ \t]*" + _PART + rb"){%d}" % _MOST_PARTS)
"""Of 20,000 parts, a key in 40 KiB takes 1.6 GiB of memory."""


def read_document(path: Path, *wanted: Sort) -> Document:
    """Return the tables of a TOML file.

    Args:
        path: of the file.
        wanted: what it may describe.

    Raises:
        ConfigError: the file cannot be read, is no TOML, or describes something else.
    """
    document = _read(path)
    found = [sort for sort, marks in _MARKS.items() if marks & document.keys()]
    if wanted and found and not set(wanted) & set(found):
        raise ConfigError(f"{path}: is {found[0]}; give {' or '.join(wanted)}")
    return document


def _read(path: Path) -> Document:
    unread = about_file(path, what="cannot be read", right="give a TOML file")
    with unread, path.open("rb") as file:
        content = file.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise ConfigError(f"{path}: is larger than {_LARGEST >> 20} MiB; give a TOML file")
    if _LONG_KEY.search(content):
        raise ConfigError(f"{path}: has a key of more than {_MOST_PARTS} parts; give shorter ones")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8") from None
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}; see https://toml.io") from None


def merge(document: Document, tables: Document) -> Document:
    """Return a document with the keys of other tables in place of its own, table by table."""
    merged = dict(document)
    for name, value in tables.items():
        old = merged.get(name)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        merged[name] = merge(old, value) if both else value  # type: ignore[arg-type]
    return merged


def read_section(document: Document, name: str, problems: Problems) -> dict[str, Given]:
    """Return the keys and values that the file gives in the table `name`."""
    value = document.get(name, {})
    if isinstance(value, dict):
        return give(name, value, Origin.FILE, problems)
    problems.add(problems.place(name), f"{describe(value)} is not a table; write it as [{name}]")
    return {}


def read_named_sections(
    document: Document, name: str, problems: Problems
) -> dict[str, dict[str, Given]]:
    """Return the keys and values that the file gives in each table ``[name.X]``, by X."""
    sections = {}
    for key, (value, _, place) in read_section(document, name, problems).items():
        if not _NAME.fullmatch(key):
            right = "give at most 32 letters, digits, _ or -"
            problems.add(problems.place(name), f"{describe(key)} cannot be a name; {right}")
        elif not isinstance(value, dict):
            problems.add(place, f"{describe(value)} is not a table; write it as [{name}.NAME]")
        else:
            sections[key] = give(f"{name}.{key}", value, Origin.FILE, problems)
    return sections


def give(
    table: str, values: Mapping[str, object], origin: Origin, problems: Problems
) -> dict[str, Given]:
    """Return `values` with their place in `table`."""
    return {key: Given(value, origin, problems.place(table, key)) for key, value in values.items()}


def check_tables(document: Document, known: tuple[str, ...], problems: Problems) -> None:
    """Note every table that is not known."""
    for name in document:
        if name not in known:
            nearest = find_nearest(name, known)
            problems.add(problems.place(name), f"unknown table; the nearest known is [{nearest}]")
