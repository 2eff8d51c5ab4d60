"""The PDOs that an EDS gives a device by default: what works of them, and what is off instead.

A default mapping tells what the real device carries. So an object that it names is carried even
where PDOMapping or AccessType deny it, and a controller written for the device finds the layout
that it expects. A PDO whose layout is unknown is off.
"""

from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device.cob_id import DISABLED, can_id
from hil_bench.canopen_device.datatypes import BOOLEAN
from hil_bench.canopen_device.eds_checks import find_mapping_faults
from hil_bench.canopen_device.eds_document import Document, EdsFinding, Severity
from hil_bench.canopen_device.eds_entries import given_default
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_mapping import (
    BITS_OF_A_BYTE,
    PDO_BITS,
    Direction,
    MappingEntry,
    reason_not_to_carry,
)

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
