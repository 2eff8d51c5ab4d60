"""An EDS file as sections of keys, each with its line, and what is wrong in it (CiA 306).

Real files deviate from CiA 306 in many ways, so nothing here refuses a file: a line that means
nothing becomes a finding and is passed over.
"""

import codecs
import math
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.canopen_device.datatypes import (
    BooleanType,
    BytesType,
    DataType,
    IntegerType,
    RealType,
    Value,
)

# Numbers and values as an EDS writes them (CiA 306).

_SUM: Final = re.compile(
    r"(?:\$NODEID\s*\+\s*)?(?P<number>-?(?:0X[0-9A-F]{1,40}|[0-9]{1,40}))(?:\s*\+\s*\$NODEID)?",
    re.IGNORECASE,
)
_AMBIGUOUS: Final = re.compile(r"-?0+(?:[1-9][0-9]+|[89])")
"""Decimal digits after a zero that mean another number in octal."""

_LONGEST_SHOWN: Final = 40


def decode_text(raw: bytes) -> str:
    """Return the text of a file; makers, loggers and spreadsheets write in any code page."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def shown(text: str) -> str:
    """Return text from a file as a message quotes it: its beginning, where it is long."""
    return repr(text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}...")


def parse_integer(text: str, node_id: int = 0) -> int:
    """Return the number of `text`: decimal, 0x hexadecimal, with or without `$NODEID+`.

    Raises:
        ValueError: it is none of these; the message says what would be right.
    """
    stripped = text.strip()
    if stripped.upper() == "$NODEID":
        return node_id
    match = _SUM.fullmatch(stripped)
    if match is None or stripped.upper().count("$NODEID") > 1:
        raise ValueError(f"{shown(text)} is no number; write 384, 0x180 or $NODEID+0x180")
    digits = match["number"]
    if _AMBIGUOUS.fullmatch(digits):
        decimal = int(digits)
        raise ValueError(
            f"{shown(text)} has a leading zero, which is octal in CiA 306 and decimal to most "
            f"tools; write {decimal} or 0x{abs(decimal):X}"
        )
    base = 16 if "X" in digits.upper() else 10
    return int(digits, base) + (node_id if "$" in stripped else 0)


def parse_value(text: str, data_type: DataType, node_id: int) -> Value:
    """Return the value of `data_type` that `text` means.

    ValueError where it means none; the message says what would be right.
    """
    if isinstance(data_type, IntegerType):
        return _parse_ranged_integer(text, data_type, node_id)
    if isinstance(data_type, RealType):
        return _parse_real(text, data_type)
    if isinstance(data_type, BooleanType):
        return _parse_boolean(text)
    if isinstance(data_type, BytesType):
        return _parse_bytes(text)
    return _parse_string(text, data_type)


def _parse_ranged_integer(text: str, data_type: IntegerType, node_id: int) -> int:
    value = parse_integer(text, node_id)
    low, high = data_type.low, data_type.high
    is_pattern = text.strip().upper().startswith("0X")
    if data_type.signed and is_pattern and value < 1 << data_type.bits:
        value = int.from_bytes(value.to_bytes(data_type.size, "little"), "little", signed=True)
    if low is None or high is None or not low <= value <= high:
        raise ValueError(f"{shown(text)} is outside {data_type.name}; write {low} to {high}")
    return value


def _parse_boolean(text: str) -> bool:
    if parse_integer(text) not in {0, 1}:
        raise ValueError(f"{shown(text)} is no BOOLEAN; write 0 or 1")
    return bool(parse_integer(text))


def _parse_real(text: str, data_type: RealType) -> float:
    """Return a decimal number, rounded to the type, or that of a 0x bit pattern.

    Raises:
        ValueError: it is neither.
    """
    stripped = text.strip().lower()
    try:
        if stripped.startswith("0x"):
            raw = int(stripped, 16).to_bytes(data_type.size, "little")
        else:
            raw = data_type.encode(float(stripped))
    except (ValueError, OverflowError, struct.error):
        raise ValueError(_no_real(text, data_type)) from None
    value = data_type.decode(raw)
    # float("3e800000") is an infinity, and was meant as the pattern of 0.25.
    if math.isinf(value) and not stripped.startswith("0x") and "inf" not in stripped:
        raise ValueError(_no_real(text, data_type))
    return value


def _no_real(text: str, data_type: RealType) -> str:
    pattern = data_type.encode(1.5)[::-1].hex().upper()
    return f"{shown(text)} is no {data_type.name}; write 1.5 or its bit pattern 0x{pattern}"


def _parse_bytes(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise ValueError(
            f"{shown(text)} is no byte string; write hexadecimal pairs: 01 A2 FF"
        ) from None


def _parse_string(text: str, data_type: DataType) -> str:
    try:
        data_type.encode(text)
    except UnicodeEncodeError:
        raise ValueError(f"{shown(text)} has characters outside {data_type.name}") from None
    return text


_OBJECT: Final = re.compile(r"([0-9A-F]{4})(?:SUB([0-9A-F]{1,2}))?", re.IGNORECASE)
_LINE_END: Final = re.compile(r"\r\n|\r|\n")
_COMMENT: Final = re.compile(r"\s;.*")
_LONGEST_NAME: Final = 40
FIRST_OBJECT: Final = 0x1000
OBJECT_LISTS: Final = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")


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
    if match is not None and (index := int(match[1], 16)) >= FIRST_OBJECT:
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


def listed_indices(section: Section) -> Iterator[tuple[int, str]]:
    """Yield the indices in a list of objects, each with its key; -1 for what is no number."""
    for key, entry in section.entries.items():
        if not key.isdecimal():
            continue
        try:
            yield parse_integer(entry.text), key
        except ValueError:
            yield -1, key
