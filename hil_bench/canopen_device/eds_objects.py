"""All entries of the object dictionary from the sections of an EDS (CiA 306)."""

from collections.abc import Iterator, Mapping
from typing import Final

from hil_bench.canopen_device.datatypes import UNSIGNED8, IntegerType
from hil_bench.canopen_device.eds_checks import required_type
from hil_bench.canopen_device.eds_document import Document, EdsFinding, Section, Severity
from hil_bench.canopen_device.eds_entries import EntryReader, given_default
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable

_VARIABLE, _ARRAY, _RECORD = 0x7, 0x8, 0x9
_OBJECT_TYPES: Final = frozenset({0x2, _VARIABLE, _ARRAY, _RECORD})
_STRUCTURE_SUBINDEX: Final = 0xFF
_MOST_ENTRIES: Final = 254
_ERROR_HISTORY: Final = 0x1003
_MAPPING: Final = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))

_MANDATORY: Final = {
    (0x1000, 0): "Device type",
    (0x1001, 0): "Error register",
    (0x1018, 0): "Highest sub-index supported",
    (0x1018, 1): "Vendor-ID",
}


def read_objects(
    document: Document, node_id: int, findings: list[EdsFinding]
) -> Iterator[Variable]:
    """Yield the entries of all objects; what is wrong with them comes to `findings`."""
    reader = EntryReader(document, node_id, findings)
    for index in sorted(document.sub_objects.keys() - document.objects.keys()):
        section = document.sub_objects[index][min(document.sub_objects[index])]
        text = f"has no object [{index:04X}]; a RECORD is taken"
        findings.append(EdsFinding(section.line, section.name, text))
        yield from _read_record(document, index, reader)
    for index, section in document.objects.items():
        yield from _read_object(document, index, section, reader)


def add_mandatory(
    document: Document, object_dictionary: ObjectDictionary, findings: list[EdsFinding]
) -> None:
    """Add the entries that every device has, where the file lacks them."""
    information = document.section("DeviceInfo") or Section("DeviceInfo", 1)
    vendor = EntryReader(document, 0, []).number(information, "VendorNumber", 0)
    values = {(0x1018, 0): 1, (0x1018, 1): vendor if vendor in range(1 << 32) else 0}
    for (index, subindex), name in _MANDATORY.items():
        data_type = required_type(index, subindex)
        if data_type is None or object_dictionary.find(index, subindex) is not None:
            continue
        value = values.get((index, subindex), 0)
        place = f"0x{index:04X}.{subindex:02X}"
        text = f"{place} is missing, and CiA 301 has it in every device; here it is 0x{value:X}"
        findings.append(EdsFinding(1, f"{index:04X}", text))
        object_dictionary.add(
            Variable(index, subindex, name, data_type, access=Access.RO, default=value)
        )


def _read_object(
    document: Document, index: int, section: Section, reader: EntryReader
) -> Iterator[Variable]:
    subs = document.sub_objects.get(index)
    kind = _object_type(section, reader, has_subs=subs is not None)
    count = reader.number(section, "CompactSubObj", 0)
    if kind not in {_ARRAY, _RECORD}:
        yield reader.build(index, 0, section)
        if subs:
            text = "its sub-indexes are passed over, for it is a VAR"
            reader.findings.append(section.finding("ObjectType", text, Severity.ERROR))
    elif count > 0:
        yield from _read_compact(document, index, section, count, reader)
    else:
        yield from _read_record(document, index, reader)


def _object_type(section: Section, reader: EntryReader, *, has_subs: bool) -> int:
    """Return the object type; where the file says none or nonsense, what the sections look like."""
    seen = _RECORD if has_subs and section.text("DataType") is None else _VARIABLE
    text = section.text("ObjectType")
    if text is None:
        return seen
    kind = reader.number(section, "ObjectType", -1)
    if kind in _OBJECT_TYPES:
        return kind
    if kind >= 0:
        wrong = f"is {text}; 0x2, 0x7, 0x8 or 0x9 is right, 0x{seen:X} is taken"
        reader.findings.append(section.finding("ObjectType", wrong))
    return seen


def _read_record(document: Document, index: int, reader: EntryReader) -> Iterator[Variable]:
    """Yield the entries of an ARRAY or RECORD, sub-index 0 included."""
    subs = document.sub_objects.get(index, {})
    entries = {sub: reader.build(index, sub, section) for sub, section in subs.items()}
    count = _count(index, entries)
    if 0 not in entries:
        section = document.objects.get(index) or document.describing(index, min(entries))
        text = f"[{index:04X}sub0] is missing; sub-index 0 is {count}"
        reader.findings.append(EdsFinding(section.line, section.name, text))
        entries[0] = _highest_subindex(index, count, "Highest sub-index supported")
    elif given_default(subs[0])[1] is None and isinstance(entries[0].data_type, IntegerType):
        entries[0].default = entries[0].value = min(count, int(entries[0].data_type.high or 0))
    yield from entries.values()


def _highest_subindex(index: int, count: int, name: str) -> Variable:
    data_type = required_type(index, 0) or UNSIGNED8
    access = Access.RW if index == _ERROR_HISTORY or _is_mapping(index) else Access.RO
    return Variable(index, 0, name, data_type, access=access, default=count)


def _count(index: int, entries: Mapping[int, Variable]) -> int:
    """Return the value of an object's sub-index 0 from its other entries."""
    if index == _ERROR_HISTORY:
        return 0
    if not _is_mapping(index):
        return max((sub for sub in entries if sub != _STRUCTURE_SUBINDEX), default=0)
    count = 0
    while (entry := entries.get(count + 1)) is not None and entry.default:
        count += 1
    return count


def _is_mapping(index: int) -> bool:
    return any(index in indices for indices in _MAPPING)


def _read_compact(
    document: Document, index: int, section: Section, count: int, reader: EntryReader
) -> Iterator[Variable]:
    """Yield the entries of an object with CompactSubObj, each like the object's own section."""
    if count > _MOST_ENTRIES:
        text = f"is {count}; a sub-index is {_MOST_ENTRIES} at most, which is taken"
        reader.findings.append(section.finding("CompactSubObj", text))
        count = _MOST_ENTRIES
    names = document.section(f"{index:04X}Name") or Section("", 1)
    values = document.section(f"{index:04X}Value") or Section("", 1)
    entries = {}
    for subindex in range(1, count + 1):
        variable = entries[subindex] = reader.build(index, subindex, section)
        variable.name = names.text(str(subindex)) or f"{variable.name}_{subindex:x}"
        reader.set_default(values, str(subindex), variable)
    yield _highest_subindex(index, _count(index, entries), "NrOfObjects")
    yield from entries.values()
