"""Each object by itself: type, access, default and limits, sub-indexes (CiA 306)."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from hil_bench.canopen_device.datatypes import DATA_TYPES, DataType, Value
from hil_bench.canopen_device.eds_values import parse_integer, parse_value
from hil_bench.eds_check.document import Document, Finding, Section

_DOMAIN, _VARIABLE, _ARRAY, _RECORD = 0x2, 0x7, 0x8, 0x9
_ACCESS: Final = ("ro", "wo", "rw", "rwr", "rww", "const")
_ANY_NODE_ID: Final = 1


def check_objects(document: Document) -> Iterator[Finding]:
    """Yield what is wrong with the objects and their sub-indexes."""
    for index, section in document.objects():
        if section.text("ParameterName") is None:
            yield section.finding("ParameterName", "is missing; any text is right")
        kind = object_type(section)
        if kind in {_ARRAY, _RECORD}:
            yield from _check_structure(document, index, section)
        elif kind in {_VARIABLE, _DOMAIN}:
            yield from _check_variable(section)
        else:
            text = section.text("ObjectType")
            yield section.finding("ObjectType", f"is {text}; 0x2, 0x7, 0x8 or 0x9 is right")


def object_type(section: Section) -> int | None:
    """Return the object type, 0x7 where the file says none, None where it says nonsense."""
    return number(section, "ObjectType", absent=_VARIABLE)


def number(section: Section, key: str, *, absent: int | None = None) -> int | None:
    """Return the number of a key, `absent` where it is missing, None where it is none."""
    text = section.text(key)
    if text is None:
        return absent
    try:
        return parse_integer(text, _ANY_NODE_ID)
    except ValueError:
        return None


def data_type_of(section: Section) -> DataType | None:
    """Return the data type of a variable, None where it is missing or unknown."""
    code = number(section, "DataType")
    return None if code is None else DATA_TYPES.get(code)


def _check_structure(document: Document, index: int, section: Section) -> Iterator[Finding]:
    if section.text("CompactSubObj") is not None:
        yield from _check_variable(section)
        return
    subs = document.sub_objects(index)
    stated = number(section, "SubNumber")
    if stated != len(subs):
        there = section.text("SubNumber")
        text = f"is {there}; {len(subs)} is right by the sections [{section.name}sub...]"
        yield section.finding("SubNumber", text)
    if 0 not in subs:
        yield Finding(section.line, section.name, f"[{section.name}sub0] is missing")
    for sub in subs.values():
        if sub.text("ParameterName") is None:
            yield sub.finding("ParameterName", "is missing; any text is right")
        yield from _check_variable(sub)


def _check_variable(section: Section) -> Iterator[Finding]:
    access = section.text("AccessType")
    if (access or "").lower() not in _ACCESS:
        yield section.finding("AccessType", f"is {access}; one of {', '.join(_ACCESS)} is right")
    if section.text("PDOMapping") not in {None, "0", "1", "0x0", "0x1"}:
        yield section.finding("PDOMapping", f"is {section.text('PDOMapping')}; 0 or 1 is right")
    data_type = data_type_of(section)
    if data_type is None:
        text = section.text("DataType")
        yield section.finding("DataType", f"is {text}; a data type of CiA 301 is right: 0x7")
        return
    yield from _check_values(section, data_type)


def _check_values(section: Section, data_type: DataType) -> Iterator[Finding]:
    values: dict[str, Value] = {}
    for key in ("LowLimit", "DefaultValue", "HighLimit"):
        text = section.text(key)
        if text is None:
            continue
        if "$NODEID" in text.upper() and not text.upper().startswith("$NODEID"):
            yield section.finding(key, f"is {text}; $NODEID as the first operand is right")
        try:
            values[key] = parse_value(text, data_type, _ANY_NODE_ID)
        except ValueError as error:
            yield section.finding(key, str(error))
    ordered = [(key, value) for key, value in values.items() if isinstance(value, int | float)]
    for (low_key, low), (high_key, high) in pairwise(ordered):
        if low > high:
            yield section.finding(low_key, f"is {low}, above {high_key}, which is {high}")
