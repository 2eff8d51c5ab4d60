"""The TOML file: its text to tables, and its tables to values that know where they stand."""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from itertools import chain
from pathlib import Path
from typing import Any, Final, Protocol, Self

from hil_bench.config.settings import Given, Key, Origin, Problems, Settings, open_table, read_table
from hil_bench.config.values import Reader, Value, describe, find_nearest
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


_NOT_UTF_8 = "is not UTF-8 text; save it as UTF-8"


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
        wrong = "is no text; give a TOML file" if b"\0" in content else _NOT_UTF_8
        raise ConfigError(f"{path}: {wrong}") from None
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
    given = Given(document.get(name, {}), Origin.FILE, problems.place(name))
    return open_table(name, given, problems)


def read_named_sections(
    document: Document, name: str, problems: Problems
) -> dict[str, dict[str, Given]]:
    """Return the keys and values that the file gives in each table ``[name.X]``, by X."""
    sections = {}
    for key, given in read_section(document, name, problems).items():
        if not _NAME.fullmatch(key):
            right = "give at most 32 letters, digits, _ or -"
            problems.add(problems.place(name), f"{describe(key)} cannot be a name; {right}")
        elif not isinstance(given.value, dict):
            wrong = f"{describe(given.value)} is not a table"
            problems.add(given.place, f"{wrong}; write it as [{name}.NAME]")
        else:
            sections[key] = open_table(f"{name}.{key}", given, problems)
    return sections


def check_tables(document: Document, known: tuple[str, ...], problems: Problems) -> None:
    """Note every table that is not known."""
    for name in document:
        if name not in known:
            nearest = find_nearest(name, known)
            problems.add(problems.place(name), f"unknown table; the nearest known is [{nearest}]")


class Tables:
    """The tables of a TOML file, each read by its keys.

    Args:
        document: the file.
        problems: where problems are noted.

    Attributes:
        document: as passed in.
        problems: as passed in.
    """

    def __init__(self, document: Document, problems: Problems) -> None:
        self.document, self.problems = document, problems

    @classmethod
    def of_file(cls, path: Path, sort: Sort, known: tuple[str, ...]) -> Self:
        """Return the tables of a file.

        Args:
            path: of the file.
            sort: of file that it is to be.
            known: the tables that it may have.
        """
        tables = cls(read_document(path, sort), Problems(str(path)))
        check_tables(tables.document, known, tables.problems)
        return tables

    def head(self, keys: Sequence[Key], tables: Sequence[str]) -> Settings:
        """Return the settings that stand above all tables.

        Args:
            keys: that may stand there.
            tables: that the file may have, too.
        """
        names, given = tuple(key.name for key in keys), {}
        for name, value in self.document.items():
            if name in names:
                given[name] = value
            elif name not in tables:
                nearest = find_nearest(name, (*names, *tables))
                place = self.problems.place("", name)
                self.problems.add(place, f"unknown; the nearest known is {nearest}")
        return read_table("", given, keys, self.problems)

    def table(self, name: str, keys: Sequence[Key]) -> Settings:
        """Return the settings of ``[name]``."""
        return read_table(name, self.section(name), keys, self.problems)

    def named(self, name: str, keys: Sequence[Key]) -> dict[str, Settings]:
        """Return the settings of each ``[name.X]``, by X."""
        sections = read_named_sections(self.document, name, self.problems)
        return {
            key: read_table(f"{name}.{key}", given, keys, self.problems)
            for key, given in sections.items()
        }

    def entries(self, name: str, read: Reader) -> dict[str, Value]:
        """Return the values of ``[name]``, whose keys are names; one that is wrong is left out."""
        found = {}
        for key, given in self.section(name).items():
            try:
                found[key] = read(given.value)
            except ConfigError as error:
                self.problems.add(given.place, error)
        return found

    def section(self, name: str) -> dict[str, Given]:
        """Return the keys and values of ``[name]``, not yet read."""
        return read_section(self.document, name, self.problems)

    def listed(self, name: str) -> list[tuple[str, Mapping[str, object]]]:
        """Return the values of each ``[[name]]``, with its name, as in ``name[1]``."""
        found = self.document.get(name, [])
        if isinstance(found, list) and all(isinstance(each, dict) for each in found):
            return [(f"{name}[{number}]", each) for number, each in enumerate(found, 1)]
        wrong = f"{describe(found)} is no list; write it as [[{name}]]"
        self.problems.add(self.problems.place(name), wrong)
        return []


# Sections: what a file says of one feature, as an object that loading asks in three steps.
#
# Whoever loads a file makes all sections, which reads their tables, then lets each resolve what it
# takes from the others, then has each build its part of the record. So loading knows no feature.


class Section(Protocol):
    """One feature of a configuration file; its tables are read when it is made."""

    def resolve(self) -> None:
        """Fill in what follows from other sections, and note what does not fit together."""

    def build(self) -> dict[str, Any]:
        """Return the attributes of the record of the whole that this section fills."""

    def tables(self) -> Iterable[Settings]:
        """Return its tables as a person would write them."""


def build_sections(sections: Sequence[Section], problems: Problems) -> dict[str, Any]:
    """Return all attributes of the record that sections describe.

    A `ConfigError` has the problems of a step, a line each: no section resolves what was read
    wrong, and none builds what does not fit together.

    Args:
        sections: as they were read.
        problems: what they have noted so far, and go on noting.
    """
    problems.raise_any()
    for section in sections:
        section.resolve()
    problems.raise_any()
    parts = [section.build() for section in sections]
    problems.raise_any()
    used = chain.from_iterable(table.values() for each in sections for table in each.tables())
    return {"settings": tuple(used)} | {name: part[name] for part in parts for name in part}
