"""Checks of an object's section by CiA 306 that no loader makes."""

from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device.eds_document import Document, EdsFinding, Section, parse_integer

_STRUCTURES: Final = (0x8, 0x9)
_VALUES: Final = ("LowLimit", "HighLimit", "DefaultValue", "ParameterValue")


def check_objects(document: Document) -> Iterator[EdsFinding]:
    """Yield what is wrong with the objects and their sub-indexes."""
    for index, section in document.objects.items():
        subs = document.sub_objects.get(index, {})
        yield from _check_count(section, len(subs))
        for described in (section, *subs.values()):
            yield from _check_operands(described)


def _check_count(section: Section, there: int) -> Iterator[EdsFinding]:
    """Yield a SubNumber that is not the number of sections."""
    if _number(section.text("ObjectType")) not in _STRUCTURES:
        return
    stated = section.text("SubNumber")
    if section.text("CompactSubObj") is None and _number(stated) != there:
        text = f"is {stated}; {there} is right by the sections [{section.name}sub...]"
        yield section.finding("SubNumber", text)


def _check_operands(section: Section) -> Iterator[EdsFinding]:
    for key in _VALUES:
        text = section.text(key)
        if text and "$NODEID" in text.upper() and not text.upper().startswith("$NODEID"):
            yield section.finding(key, f"is {text}; $NODEID as the first operand is right")


def _number(text: str | None) -> int | None:
    try:
        return parse_integer(text or "")
    except ValueError:
        return None
