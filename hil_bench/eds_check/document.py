"""An EDS file as sections of keys, each with its line."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

_OBJECT = re.compile(r"([0-9A-F]{4})", re.IGNORECASE)
_SUB_OBJECT = re.compile(r"([0-9A-F]{4})sub([0-9A-F]{1,2})", re.IGNORECASE)


class Finding(NamedTuple):
    """One thing that is wrong.

    Attributes:
        line: where, from 1.
        section: the section it is in, empty where it is in none.
        text: what is wrong, and what would be right.
    """

    line: int
    section: str
    text: str

    def __str__(self) -> str:
        return f"line {self.line}: [{self.section}] {self.text}"


class Entry(NamedTuple):
    """The value of a key and its line."""

    text: str
    line: int


@dataclass(slots=True)
class Section:
    """One section.

    Attributes:
        name: as it is written.
        line: of its heading.
        entries: keys in lower case, as EDS keys are not case sensitive.
    """

    name: str
    line: int
    entries: dict[str, Entry] = field(default_factory=dict)

    def finding(self, key: str, text: str) -> Finding:
        """Return a finding about a key, at its line, or at the heading where it is missing."""
        entry = self.entries.get(key.lower())
        return Finding(entry.line if entry else self.line, self.name, f"{key}: {text}")

    def text(self, key: str) -> str | None:
        """Return the value of a key, None where it is missing or empty."""
        entry = self.entries.get(key.lower())
        return entry.text if entry and entry.text else None


@dataclass(slots=True)
class Document:
    """All sections of a file.

    Attributes:
        sections: by name in lower case.
        findings: what is wrong with the file's form.
    """

    sections: dict[str, Section] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)

    def section(self, name: str) -> Section | None:
        """Return a section by its name, whatever its case."""
        return self.sections.get(name.lower())

    def objects(self) -> Iterator[tuple[int, Section]]:
        """Yield index and section of every object, as they stand in the file."""
        for section in self.sections.values():
            if match := _OBJECT.fullmatch(section.name):
                yield int(match[1], 16), section

    def sub_objects(self, index: int) -> dict[int, Section]:
        """Return the sections of an object's sub-indexes."""
        matches = ((_SUB_OBJECT.fullmatch(s.name), s) for s in self.sections.values())
        return {int(m[2], 16): s for m, s in matches if m and int(m[1], 16) == index}


def parse_document(text: str) -> Document:
    """Return the sections of an EDS file; lines that are neither become findings."""
    document = Document()
    section = Section("", 1)
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith(";"):
            continue
        if line.startswith("["):
            section = _begin(document, line, number)
        elif "=" in line:
            _add(document, section, line, number)
        else:
            message = f"{line[:40]!r} is no [section], key=value or ; comment"
            document.findings.append(Finding(number, section.name, message))
    return document


def _begin(document: Document, line: str, number: int) -> Section:
    name = line[1:].partition("]")[0].strip()
    section = Section(name, number)
    if "]" not in line:
        document.findings.append(Finding(number, name, "the heading lacks its ]"))
    first = document.section(name)
    if first is not None:
        message = f"stands at line {first.line} already; a section stands once"
        document.findings.append(Finding(number, name, message))
        return section
    document.sections[name.lower()] = section
    return section


def _add(document: Document, section: Section, line: str, number: int) -> None:
    key, _, value = (part.strip() for part in line.partition("="))
    first = section.entries.get(key.lower())
    if not section.name:
        document.findings.append(Finding(number, "", f"{key}: stands before the first section"))
    elif first is not None:
        message = f"{key}: stands at line {first.line} already; a key stands once"
        document.findings.append(Finding(number, section.name, message))
    else:
        section.entries[key.lower()] = Entry(value, number)
