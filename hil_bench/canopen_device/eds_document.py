"""An EDS file as sections of keys, each with its line, and what is wrong in it (CiA 306).

Real files deviate from CiA 306 in many ways, so nothing here refuses a file: a line that means
nothing becomes a finding and is passed over.
"""

import re
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.canopen_device.eds_values import shown

_OBJECT: Final = re.compile(r"([0-9A-F]{4})(?:SUB([0-9A-F]{1,2}))?", re.IGNORECASE)
_LINE_END: Final = re.compile(r"\r\n|\r|\n")
_COMMENT: Final = re.compile(r"\s;.*")
_LONGEST_NAME: Final = 40
_FIRST_OBJECT: Final = 0x1000


class Severity(StrEnum):
    """The severity of a finding for the device."""

    ERROR = "error"
    """Something that the file describes will not work."""
    WARNING = "warning"
    """The file deviates from CiA 306, and all that it describes works."""


class EdsFinding(NamedTuple):
    """One thing that is wrong in a file.

    Attributes:
        line: where, from 1.
        section: the section it is in, empty where it is in none.
        text: what is wrong, and what would be right or what follows.
        severity: whether something does not work.
    """

    line: int
    section: str
    text: str
    severity: Severity = Severity.WARNING

    def __str__(self) -> str:
        return f"{self.line}: {self.severity}: [{self.section}] {self.text}"


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

    def finding(self, key: str, text: str, severity: Severity = Severity.WARNING) -> EdsFinding:
        """Return a finding about a key, at its line, or at the heading where it is missing."""
        entry = self.entries.get(key.lower())
        line = entry.line if entry else self.line
        return EdsFinding(line, self.name, f"{key}: {text}", severity)

    def text(self, key: str) -> str | None:
        """Return the value of a key, None where it is missing or empty."""
        entry = self.entries.get(key.lower())
        return entry.text if entry and entry.text else None


@dataclass(slots=True)
class Document:
    """All sections of a file.

    Attributes:
        sections: by name in lower case.
        objects: the section of each object, by index, in the order of the file.
        sub_objects: the sections of each object's sub-indexes, by index and sub-index.
        findings: what is wrong with the file's form.
    """

    sections: dict[str, Section] = field(default_factory=dict)
    objects: dict[int, Section] = field(default_factory=dict)
    sub_objects: dict[int, dict[int, Section]] = field(default_factory=dict)
    findings: list[EdsFinding] = field(default_factory=list)

    def section(self, name: str) -> Section | None:
        """Return a section by its name, whatever its case."""
        return self.sections.get(name.lower())

    def describing(self, index: int, subindex: int) -> Section:
        """Return the section that describes an entry, an empty one where there is none."""
        section = self.sub_objects.get(index, {}).get(subindex) or self.objects.get(index)
        return section or Section(f"{index:04X}", 1)


def parse_document(text: str) -> Document:
    """Return the sections of an EDS file; lines that are neither become findings."""
    document = Document()
    section = Section("", 1)
    for number, raw in enumerate(_LINE_END.split(text), start=1):
        line = raw.strip()
        if not line or line[0] in ";#":
            continue
        if line[0] == "[":
            section = _begin(document, line, number)
        elif "=" in line:
            _add(document, section, line, number)
        else:
            message = f"{shown(line)} is no [section], key=value or ; comment; it is passed over"
            document.findings.append(EdsFinding(number, section.name, message))
    return document


def _begin(document: Document, line: str, number: int) -> Section:
    name, bracket, _ = line[1:].partition("]")
    section = Section(name.strip()[:_LONGEST_NAME], number)
    if not bracket:
        document.findings.append(EdsFinding(number, section.name, "the heading lacks its ]"))
    first = document.section(section.name)
    if first is not None:
        message = f"stands at line {first.line} already; what stands there counts"
        document.findings.append(EdsFinding(number, section.name, message))
        return section
    document.sections[section.name.lower()] = section
    match = _OBJECT.fullmatch(section.name)
    if match is not None and (index := int(match[1], 16)) >= _FIRST_OBJECT:
        if match[2] is None:
            document.objects[index] = section
        else:
            document.sub_objects.setdefault(index, {}).setdefault(int(match[2], 16), section)
    return section


def _add(document: Document, section: Section, line: str, number: int) -> None:
    if ";" in line:
        line = _COMMENT.sub("", line)
    key, _, value = line.partition("=")
    key = key.strip()
    first = section.entries.get(key.lower())
    if not section.name:
        text = f"{shown(key)} stands before the first section; it is passed over"
        document.findings.append(EdsFinding(number, "", text))
    elif first is not None:
        message = f"{key}: stands at line {first.line} already; what stands there counts"
        document.findings.append(EdsFinding(number, section.name, message))
    else:
        section.entries[key.lower()] = Entry(value.strip(), number)
