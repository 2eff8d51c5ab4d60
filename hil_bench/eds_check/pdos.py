"""PDOs as the EDS makes them by default: identifiers, mapped objects, lengths (CiA 301, 306)."""

from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device.cob_id import check_identifier
from hil_bench.canopen_device.pdo_mapping import PDO_BITS, Direction, MappingEntry
from hil_bench.eds_check.document import Document, Finding, Section
from hil_bench.eds_check.objects import data_type_of, number
from hil_bench.errors import SdoAbort

_COMMUNICATION: Final = {
    Direction.RPDO: range(0x1400, 0x1600),
    Direction.TPDO: range(0x1800, 0x1A00),
}
_MAPPING_OFFSET: Final = 0x200
_DUMMIES: Final = range(0x0001, 0x0008)
_WRITABLE: Final = ("rw", "wo", "rww")
_READABLE: Final = ("ro", "rw", "rwr", "const")


def check_pdos(document: Document) -> Iterator[Finding]:
    """Yield what is wrong with the PDOs."""
    for index, section in document.objects():
        for direction, indices in _COMMUNICATION.items():
            if index in indices:
                yield from _check_identifier(document, index, section)
                yield from _check_partner(document, section, index + _MAPPING_OFFSET)
            elif index - _MAPPING_OFFSET in indices:
                yield from _check_partner(document, section, index - _MAPPING_OFFSET)
                yield from _check_mapping(document, index, direction)


def _check_identifier(document: Document, index: int, section: Section) -> Iterator[Finding]:
    sub = document.sub_objects(index).get(1)
    if sub is None:
        yield Finding(section.line, section.name, f"[{section.name}sub1], the COB-ID, is missing")
        return
    cob_id = number(sub, "DefaultValue")
    if cob_id is None:
        return
    try:
        check_identifier(cob_id & ~(1 << 30))
    except SdoAbort:
        text = f"is {sub.text('DefaultValue')}; an identifier that CiA 301 leaves to PDOs is right"
        yield sub.finding("DefaultValue", text)


def _check_partner(document: Document, section: Section, index: int) -> Iterator[Finding]:
    if document.section(f"{index:04X}") is None:
        text = f"[{index:04X}] is missing; a PDO has communication and mapping parameters"
        yield Finding(section.line, section.name, text)


def _check_mapping(document: Document, index: int, direction: Direction) -> Iterator[Finding]:
    subs = document.sub_objects(index)
    count = number(subs[0], "DefaultValue", absent=0) if 0 in subs else 0
    bits = 0
    for subindex in range(1, (count or 0) + 1):
        section = subs.get(subindex)
        raw = number(section, "DefaultValue") if section else None
        if section is None or not raw:
            text = f"maps {count} objects; sub-index {subindex} holds none"
            yield subs[0].finding("DefaultValue", text)
            continue
        entry = MappingEntry.parse(raw)
        bits += entry.bits
        if (reason := _refusal(document, entry, direction)) is not None:
            yield section.finding("DefaultValue", f"maps {entry}, which {reason}")
    if bits > PDO_BITS:
        text = f"maps {bits} bit; at most {PDO_BITS} fit into a frame"
        yield subs[0].finding("DefaultValue", text)


def _refusal(document: Document, entry: MappingEntry, direction: Direction) -> str | None:
    """Return why an object cannot be mapped, None where it can."""
    if entry.index in _DUMMIES and direction is Direction.RPDO:
        return None
    section = _variable(document, entry)
    if section is None:
        return "does not exist"
    if number(section, "PDOMapping", absent=0) != 1:
        return "has PDOMapping=0"
    access = (section.text("AccessType") or "").lower()
    if access not in (_WRITABLE if direction is Direction.RPDO else _READABLE):
        return f"has AccessType={access}, which no {direction.value} may carry"
    data_type = data_type_of(section)
    if data_type is not None and data_type.bits and data_type.bits != entry.bits:
        return f"has {data_type.bits} bit ({data_type.name})"
    return None


def _variable(document: Document, entry: MappingEntry) -> Section | None:
    section = document.section(f"{entry.index:04X}")
    if section is None:
        return None
    if section.text("CompactSubObj") is not None:
        return section
    subs = document.sub_objects(entry.index)
    return subs.get(entry.subindex) if subs else (section if entry.subindex == 0 else None)
