"""An EDS file as an object dictionary."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

from hil_bench.canopen_device.datatypes import BOOLEAN, UNSIGNED8, IntegerType
from hil_bench.canopen_device.eds_checks import find_mapping_faults, required_type
from hil_bench.canopen_device.eds_document import (
    FIRST_OBJECT,
    OBJECT_LISTS,
    Document,
    EdsFinding,
    Section,
    Severity,
    decode_text,
    listed_indices,
    parse_document,
)
from hil_bench.canopen_device.eds_entries import EntryReader, given_default
from hil_bench.canopen_device.errors import EdsError
from hil_bench.canopen_device.frame import DISABLED, can_id
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import (
    BITS_OF_A_BYTE,
    PDO_BITS,
    Direction,
    MappingEntry,
    reason_not_to_carry,
)

# All entries of the object dictionary from the sections of an EDS (CiA 306).


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


def find_absent(document: Document) -> Iterator[EdsFinding]:
    """Yield the objects that the lists name, and that the device does not have."""
    added = {index for index, _ in _MANDATORY}
    for section in filter(None, map(document.section, OBJECT_LISTS)):
        for index, key in listed_indices(section):
            is_there = index in added or index in document.objects or index in document.sub_objects
            if FIRST_OBJECT <= index <= 0xFFFF and not is_there:
                text = f"0x{index:04X} has no section [{index:04X}]; the device does not have it"
                yield section.finding(key, text, Severity.ERROR)


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


# The PDOs that an EDS gives a device by default: what works of them, and what is off instead.
#
# A default mapping tells what the real device carries. So an object that it names is carried even
# where PDOMapping or AccessType deny it, and a controller written for the device finds the layout
# that it expects. A PDO whose layout is unknown is off.

_COMMUNICATION: Final = {
    Direction.RPDO: range(0x1400, 0x1600),
    Direction.TPDO: range(0x1800, 0x1A00),
}
_TO_MAPPING: Final = 0x200
_SYNC: Final = 0x1005
_NOT_SYNCHRONOUS: Final = 241
"""The first transmission type that does not ask for SYNC."""
_MULTIPLEXED: Final = frozenset({0xFE, 0xFF})
"""Numbers of mapped objects that mean SAM-MPDO and DAM-MPDO (CiA 301)."""


def settle_pdos(
    document: Document, object_dictionary: ObjectDictionary, findings: list[EdsFinding]
) -> None:
    """Let each PDO work as the file has it, or switch it off, and tell so in `findings`."""
    findings += _missing_sync(document, object_dictionary)
    for direction, indices in _COMMUNICATION.items():
        for index in object_dictionary.indices(indices):
            name = f"{direction.value}{index - indices.start + 1}"
            findings += _Pdo(document, object_dictionary, index, direction, name).settle()
        mappings = range(indices.start + _TO_MAPPING, indices.stop + _TO_MAPPING)
        for mapping in object_dictionary.indices(mappings):
            index = mapping - _TO_MAPPING
            if index not in object_dictionary:
                name = f"{direction.value}{index - indices.start + 1}"
                section = document.describing(mapping, 0)
                text = f"0x{index:04X} with its COB-ID is missing; there is no {name}"
                findings.append(EdsFinding(section.line, section.name, text, Severity.ERROR))


def _missing_sync(document: Document, object_dictionary: ObjectDictionary) -> Iterator[EdsFinding]:
    """Yield that a synchronous PDO has no SYNC; the first one tells it for all."""
    if _SYNC in object_dictionary:
        return
    for indices in _COMMUNICATION.values():
        for index in object_dictionary.indices(indices):
            if object_dictionary.number(index, 2, absent=_NOT_SYNCHRONOUS) < _NOT_SYNCHRONOUS:
                section = document.describing(index, 2)
                text = f"is synchronous, and 0x{_SYNC:04X} is missing; SYNC is 0x080 here"
                yield section.finding(given_default(section)[0], text)
                return


class _Pdo:
    """One PDO as the file describes it."""

    def __init__(
        self,
        document: Document,
        object_dictionary: ObjectDictionary,
        index: int,
        direction: Direction,
        name: str,
    ) -> None:
        self._document = document
        self._object_dictionary = object_dictionary
        self._index = index
        self._mapping = index + _TO_MAPPING
        self._direction = direction
        self._name = name

    def settle(self) -> Iterator[EdsFinding]:
        """Yield what is wrong, and let the PDO be what it then is."""
        cob_id = self._object_dictionary.find(self._index, 1)
        yield from self._identifier_findings(cob_id)
        if self._object_dictionary.find(self._index, 2) is None:
            text = "is missing; the transmission type is 255"
            yield self._finding(self._index, 2, text, Severity.WARNING)
        unmapped = list(self._unmapped())
        if not unmapped:
            yield from self._carried()
            unmapped = list(self._faults())
        if unmapped:
            self._switch_off(cob_id)
            yield from unmapped

    def _identifier_findings(self, cob_id: Variable | None) -> Iterator[EdsFinding]:
        if cob_id is None:
            text = f"is missing; {self._name} has no COB-ID, and is off"
            yield self._finding(self._index, 1, text)
        elif not cob_id.default & DISABLED and can_id(cob_id.default) is None:
            text = f"is 0x{cob_id.default:X}, which no PDO may have; {self._name} is off"
            _disable(cob_id)
            yield self._finding(self._index, 1, text)

    def _unmapped(self) -> Iterator[EdsFinding]:
        """Yield why the PDO has no mapping at all."""
        if self._object_dictionary.find(self._mapping) is None:
            text = f"0x{self._mapping:04X} with its mapping is missing; {self._name} is off"
            section = self._document.describing(self._index, 0)
            yield EdsFinding(section.line, f"{self._index:04X}", text, Severity.ERROR)

    def _carried(self) -> Iterator[EdsFinding]:
        """Yield the mapped objects that their own keys exclude; they are carried all the same."""
        for subindex, entry in self._entries():
            variable = self._object_dictionary.find(entry.index, entry.subindex)
            if variable is None:
                continue
            reason = reason_not_to_carry(variable, self._direction)
            if reason is not None:
                variable.is_carried = True
                text = f"maps {entry}, which {reason}; {self._name} carries it all the same"
                yield self._finding(self._mapping, subindex, text, Severity.WARNING)
            if variable.data_type is BOOLEAN and entry.bits == BITS_OF_A_BYTE:
                text = f"maps {entry}, a BOOLEAN, with 8 bit; it takes a byte, 0 or 1"
                yield self._finding(self._mapping, subindex, text, Severity.WARNING)

    def _faults(self) -> Iterator[EdsFinding]:
        """Yield why the mapping cannot be used."""
        count = self._object_dictionary.number(self._mapping)
        if count > PDO_BITS:
            what = "says that it is a multiplexed PDO" if count in _MULTIPLEXED else f"is {count}"
            text = f"{what}; 0 to {PDO_BITS} mapped objects are supported, {self._name} is off"
            yield self._finding(self._mapping, 0, text)
            return
        for fault in find_mapping_faults(self._object_dictionary, self._mapping, self._direction):
            text = f"{fault.text}; {self._name} is off"
            yield self._finding(self._mapping, fault.subindex or 0, text)
            if self._object_dictionary.find(self._mapping, fault.subindex or 0) is None:
                return  # and so are the following

    def _entries(self) -> Iterator[tuple[int, MappingEntry]]:
        for subindex in range(1, self._object_dictionary.number(self._mapping) + 1):
            variable = self._object_dictionary.find(self._mapping, subindex)
            if variable is not None:
                yield subindex, MappingEntry.parse(variable.value)

    def _switch_off(self, cob_id: Variable | None) -> None:
        """Disable the PDO, and forget its mapping, until a master writes them anew."""
        if cob_id is not None:
            _disable(cob_id)
        count = self._object_dictionary.find(self._mapping)
        if count is not None:
            count.default = count.value = 0
            count.base = None

    def _finding(
        self, index: int, subindex: int, text: str, severity: Severity = Severity.ERROR
    ) -> EdsFinding:
        section = self._document.sub_objects.get(index, {}).get(subindex)
        if section is None:
            head = self._document.describing(index, 0)
            return EdsFinding(
                head.line, f"{index:04X}", f"[{index:04X}sub{subindex:X}] {text}", severity
            )
        return section.finding(given_default(section)[0], text, severity)


def _disable(cob_id: Variable) -> None:
    cob_id.default = cob_id.value = cob_id.default | DISABLED
    if cob_id.base is not None:
        cob_id.base |= DISABLED


# EDS files (CiA 306) to object dictionaries.
#
# Real EDS files deviate from CiA 306. What is wrong in one costs no more than the limit, the text,
# the default or the PDO that it concerns, and is told as a finding with its line and what follows.
# Refused is only what is no EDS at all. Parameter values of a DCF take the place of the EDS
# defaults.


LARGEST_FILE: Final = 8 * 1024 * 1024
"""Longest file that is read [byte]; real ones are below a megabyte."""

_HIGHEST_NODE_ID: Final = 127
_FILES_KEPT: Final = 8
_DEVICES_KEPT: Final = 128
_HEADERS: Final = ("FileInfo", "DeviceInfo", "MandatoryObjects")
_RIGHT: Final = "give the EDS file (CiA 306) of the device"


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Return the object dictionary of the EDS or DCF at `path`, for the device `node_id`.

    Its `findings` tell what is wrong in the file, and what the device has in its place.

    For a device without node-ID (255) the defaults are those of node-ID 127, until
    `ObjectDictionary.assign_node_id` tells its own.

    Raises:
        EdsError: the file is no EDS, or the node-ID is not 1 to 127 or 255; one line that names
            the file, what is wrong and what would be right.
    """
    if node_id == UNCONFIGURED:
        node_id = _HIGHEST_NODE_ID
    if not 1 <= node_id <= _HIGHEST_NODE_ID:
        raise EdsError(
            f"{path}: node-ID {node_id} is not possible; write 1 to 127, or 255 for none"
        )
    text, source = read_eds(path), str(path)
    parse_eds(text, source)
    return _template(text, node_id).copy(source)


def commissioned_node_id(path: Path) -> int | None:
    """Return the node-ID for which a DCF was made; None where the file says none."""
    document = parse_eds(read_eds(path), str(path))
    section = document.section("DeviceComissioning") or Section("DeviceComissioning", 1)
    node_id = EntryReader(document, 0, []).number(section, "NodeID", 0)
    return node_id if 1 <= node_id <= _HIGHEST_NODE_ID else None


def read_eds(path: Path) -> str:
    """Return the text of the file at `path`.

    Raises:
        EdsError: it cannot be read, or is too long.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise EdsError(f"{path}: {error.strerror or error}; name an EDS file that exists") from None
    if len(raw) > LARGEST_FILE:
        raise EdsError(f"{path}: is longer than {LARGEST_FILE} bytes; {_RIGHT}")
    return decode_text(raw)


def parse_eds(text: str, source: str) -> Document:
    """Return the sections of an EDS or DCF.

    Raises:
        EdsError: it is no EDS.
    """
    document = _parse(text)
    refusal = find_refusal(document, text)
    if refusal is not None:
        raise EdsError(f"{source}: {refusal}")
    return document


def find_refusal(document: Document, text: str) -> str | None:
    """Return why a text of these sections is no EDS and what is right, None where it is one."""
    if text.lstrip().startswith("<?xml"):
        return f"is XML, as an XDD file is; {_RIGHT}"
    if not document.objects:
        return f"is no EDS file, it has no object such as [1000]; {_RIGHT}"
    if not any(document.section(name) for name in _HEADERS):
        headers = " nor ".join(f"[{name}]" for name in _HEADERS)
        return f"is no EDS file, it has neither {headers}; {_RIGHT}"
    return None


def build_objects(document: Document, node_id: int, source: str) -> ObjectDictionary:
    """Return the object dictionary that an EDS describes, for the device `node_id`."""
    findings: list[EdsFinding] = [*document.findings]
    object_dictionary = ObjectDictionary(read_objects(document, node_id, findings), source=source)
    add_mandatory(document, object_dictionary, findings)
    settle_pdos(document, object_dictionary, findings)
    findings += find_absent(document)
    information = document.section("DeviceInfo")
    claim = information.text("LSS_Supported") if information else None
    object_dictionary.claims_lss = claim not in {None, "0", "0x0"}
    object_dictionary.findings = tuple(sorted(dict.fromkeys(findings), key=_line))
    return object_dictionary


def _line(finding: EdsFinding) -> int:
    return finding.line


@lru_cache(maxsize=_FILES_KEPT)
def _parse(text: str) -> Document:
    """Return the sections of an EDS, kept for devices of the same kind; nobody changes them."""
    return parse_document(text)


@lru_cache(maxsize=_DEVICES_KEPT)
def _template(text: str, node_id: int) -> ObjectDictionary:
    """Return the objects of a device, kept for the next bench that has it; nobody changes them."""
    return build_objects(_parse(text), node_id, "")
