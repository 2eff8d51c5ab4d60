"""The lists of objects: complete, counted, each object in one of them (CiA 306)."""

from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device.eds_document import (
    Document,
    EdsFinding,
    Section,
    Severity,
    parse_integer,
)

_MANDATORY: Final = (0x1000, 0x1001, 0x1018)
_MANUFACTURER: Final = range(0x2000, 0x6000)
_LISTS: Final = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")


def check_lists(document: Document) -> Iterator[EdsFinding]:
    """Yield what is wrong between the lists and the objects' sections."""
    listed: dict[int, str] = {}
    for name in _LISTS:
        section = document.section(name)
        if section is None:
            yield EdsFinding(1, name, "the section is missing; CiA 306 asks for it")
            continue
        yield from _check_count(section)
        for index, key in _indices(section):
            yield from _check_place(document, section, key, index, listed)
            listed.setdefault(index, section.name)
    mandatory = document.section(_LISTS[0])
    if mandatory is not None:
        yield from _check_mandatory(mandatory, listed)
    for index, section in document.objects.items():
        if index not in listed:
            yield EdsFinding(section.line, section.name, "is in no list of objects; one is right")


def _check_count(section: Section) -> Iterator[EdsFinding]:
    keys = [key for key in section.entries if key.isdecimal()]
    text = section.text("SupportedObjects")
    if text is None or not text.isdecimal() or int(text) != len(keys):
        yield section.finding(
            "SupportedObjects", f"is {text}; {len(keys)} is right by what follows"
        )
    for expected, key in enumerate(keys, start=1):
        if int(key) != expected:
            yield section.finding(key, f"stands where {expected} is right: they count on from 1")
            return


def _indices(section: Section) -> Iterator[tuple[int, str]]:
    for key, entry in section.entries.items():
        if not key.isdecimal():
            continue
        try:
            yield parse_integer(entry.text), key
        except ValueError:
            yield -1, key


def _check_place(
    document: Document, section: Section, key: str, index: int, listed: dict[int, str]
) -> Iterator[EdsFinding]:
    """Yield what is wrong with one line of a list."""
    if not 0x1000 <= index <= 0xFFFF:
        yield section.finding(key, f"is {section.text(key)}; an index such as 0x1000 is right")
        return
    if index in listed:
        yield section.finding(key, f"0x{index:04X} is in [{listed[index]}] already; once is right")
    if index not in document.objects:
        text = f"0x{index:04X} has no section [{index:04X}]; the device does not have it"
        yield section.finding(key, text, Severity.ERROR)
    is_manufacturers = index in _MANUFACTURER
    if is_manufacturers != (section.name.lower() == _LISTS[2].lower()):
        right = _LISTS[2] if is_manufacturers else f"{_LISTS[0]} or {_LISTS[1]}"
        yield section.finding(key, f"0x{index:04X} belongs to {right}")


def _check_mandatory(section: Section, listed: dict[int, str]) -> Iterator[EdsFinding]:
    for index in _MANDATORY:
        if listed.get(index) != section.name:
            text = f"0x{index:04X} is not listed; CiA 301 has it in every device"
            yield EdsFinding(section.line, section.name, text)
