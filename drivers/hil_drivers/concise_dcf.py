"""Concise DCF: the configuration of a device as an NMT master keeps it (CiA 302-3, 0x1F22).

An UNSIGNED32 says how many entries follow. Each is an index (UNSIGNED16), a sub-index (UNSIGNED8),
the length of its data (UNSIGNED32) and the data, all little-endian.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from canopen.objectdictionary import ODVariable, datatypes

from hil_drivers.eds import load_eds
from hil_drivers.errors import ConciseDcfError
from hil_drivers.node import object_name

MOST_BYTES: Final = 1 << 20
"""Longest concise DCF that is read [byte]."""

_COUNT: Final = struct.Struct("<I")
_HEAD: Final = struct.Struct("<HBI")
_COMMUNICATION: Final = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
TO_MAPPING: Final = 0x200
"""From the communication parameters of a PDO to its mapping."""

INVALID: Final = 1 << 31
"""In the COB-ID of a PDO: it does not exist."""

# Commands and histories: error field, time stamp, store, restore, and what managers do.
_NO_CONFIGURATION: Final = frozenset(
    {0x1003, 0x1010, 0x1011, 0x1012, 0x1013, 0x1020, 0x1023, 0x1024, *range(0x1F50, 0x1F58)}
)

_BITS: Final = {
    datatypes.REAL32: (struct.Struct("<I"), struct.Struct("<f")),
    datatypes.REAL64: (struct.Struct("<Q"), struct.Struct("<d")),
}

ObjectKey = tuple[int, int]
"""Index and sub-index."""


@dataclass(frozen=True, slots=True)
class ConciseEntry:
    """One write of a concise DCF.

    Attributes:
        index: of the object.
        subindex: of the object.
        data: as an SDO download carries them.
    """

    index: int
    subindex: int
    data: bytes


def pack_concise_dcf(entries: Sequence[ConciseEntry]) -> bytes:
    """Return the bytes of a concise DCF."""
    parts = [
        _HEAD.pack(entry.index, entry.subindex, len(entry.data)) + entry.data for entry in entries
    ]
    return _COUNT.pack(len(entries)) + b"".join(parts)


def parse_concise_dcf(raw: bytes) -> tuple[ConciseEntry, ...]:
    """Return the entries of a concise DCF.

    Raises:
        ConciseDcfError: it is shorter or longer than it says.
    """
    if len(raw) < _COUNT.size:
        raise ConciseDcfError(f"{len(raw)} bytes are no concise DCF; it begins with 4 bytes")
    (count,) = _COUNT.unpack_from(raw)
    entries: list[ConciseEntry] = []
    place = _COUNT.size
    while len(entries) < count:
        start = place + _HEAD.size
        if start > len(raw):
            raise ConciseDcfError(f"ends after {len(entries)} of {count} entries")
        index, subindex, length = _HEAD.unpack_from(raw, place)
        place = start + length
        if place > len(raw):
            name = object_name(index, subindex)
            missing = f"{len(raw) - start} of {length} bytes are there"
            raise ConciseDcfError(f"ends within entry {len(entries) + 1}, {name}: {missing}")
        entries.append(ConciseEntry(index, subindex, raw[start:place]))
    if place < len(raw):
        raise ConciseDcfError(f"{len(raw) - place} bytes follow its {count} entries; none is right")
    return tuple(entries)


def read_concise_dcf(path: Path) -> tuple[ConciseEntry, ...]:
    """Return the entries of a file.

    Raises:
        ConciseDcfError: it cannot be read, or is no concise DCF.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise ConciseDcfError(f"{path}: cannot be read: {error.strerror}") from error
    if len(raw) > MOST_BYTES:
        raise ConciseDcfError(f"{path}: is longer than {MOST_BYTES} bytes; no concise DCF is")
    try:
        return parse_concise_dcf(raw)
    except ConciseDcfError as error:
        raise ConciseDcfError(f"{path}: {error.what}") from None


def convert_dcf(path: Path, node_id: int) -> tuple[ConciseEntry, ...]:
    """Return the entries of a DCF: each `ParameterValue` of an object that can be written.

    Args:
        path: a DCF; an EDS, which has no such values, gives no entries.
        node_id: of the device, for values with ``$NODEID``.

    Raises:
        ConciseDcfError: a value cannot be read, or does not fit the type of its object.
    """
    values: dict[ObjectKey, bytes] = {}
    defaults: dict[ObjectKey, int] = {}
    for variable in _variables(path, node_id):
        key = variable.index, variable.subindex
        if isinstance(variable.default, int):
            defaults[key] = variable.default
        text: str | None = getattr(variable, "value_raw", None)
        if not text or variable.index in _NO_CONFIGURATION or not variable.writable:
            continue
        try:
            values[key] = encode(variable, _value(variable, text))
        except ValueError:
            what = f"does not fit data type 0x{variable.data_type:04X}"
            where = f"{path}: [{_section(variable)}] ParameterValue"
            raise ConciseDcfError(f"{where} {text!r} {what}") from None
    return order_writes(values, defaults)


def encode(variable: ODVariable, value: float | str | bytes) -> bytes:
    """Return a value as an SDO download carries it.

    Raises:
        ValueError: it is none of the object's type.
    """
    try:
        raw: bytes = variable.encode_raw(value)
    except (TypeError, AttributeError, struct.error, OverflowError) as error:
        raise ValueError(str(error)) from None
    return raw


def order_writes(
    values: Mapping[ObjectKey, bytes], defaults: Mapping[ObjectKey, int]
) -> tuple[ConciseEntry, ...]:
    """Return writes in the order that a device takes them.

    What concerns PDOs comes last and follows the procedure of CiA 301: the PDO is disabled, its
    parameters are written, its mapping is emptied, written and counted, and it is enabled again.

    Args:
        values: what is to be written.
        defaults: integers of the EDS, for the COB-ID and the count of a PDO that `values` lack.
    """
    entries = [ConciseEntry(*key, values[key]) for key in sorted(values) if pdo_of(key[0]) is None]
    pdos = sorted({pdo for index, _ in values if (pdo := pdo_of(index)) is not None})
    for pdo in pdos:
        entries += _pdo_writes(pdo, values, defaults)
    return tuple(entries)


def _pdo_writes(
    communication: int, values: Mapping[ObjectKey, bytes], defaults: Mapping[ObjectKey, int]
) -> Iterable[ConciseEntry]:
    mapping = communication + TO_MAPPING
    identifier = values.get((communication, 1))
    if identifier is None and (communication, 1) in defaults:
        identifier = defaults[communication, 1].to_bytes(4, "little")
    if identifier is not None:
        disabled = int.from_bytes(identifier, "little") | INVALID
        yield ConciseEntry(communication, 1, disabled.to_bytes(4, "little"))
    for key in sorted(values):
        if key[0] == communication and key[1] > 1:
            yield ConciseEntry(*key, values[key])
    mapped = [key for key in sorted(values) if key[0] == mapping and key[1] > 0]
    count = values.get((mapping, 0))
    if count is None and mapped:
        count = bytes([defaults.get((mapping, 0), mapped[-1][1]) & 0xFF])
    if count is not None:
        yield ConciseEntry(mapping, 0, b"\0")
        # Entries beyond the count mean nothing, and may be refused.
        yield from (ConciseEntry(*key, values[key]) for key in mapped if key[1] <= count[0])
        if count[0]:
            yield ConciseEntry(mapping, 0, count)
    if identifier is not None:
        yield ConciseEntry(communication, 1, identifier)


def pdo_of(index: int) -> int | None:
    """Return the index of the communication parameters of the PDO that an object belongs to."""
    for block in _COMMUNICATION:
        for candidate in (index, index - TO_MAPPING):
            if candidate in block:
                return candidate
    return None


def _variables(path: Path, node_id: int) -> Iterable[ODVariable]:
    for entry in load_eds(path, node_id).values():
        yield from [entry] if isinstance(entry, ODVariable) else entry.values()


def _value(variable: ODVariable, text: str) -> int | float | str | bytes:
    """Return a value of a DCF; a real number may be given by its bits, ``0x3FC00000``.

    Raises:
        ValueError: it cannot be read.
    """
    value: int | float | str | bytes | None = variable.value
    if value is None and variable.data_type in _BITS:
        bits, real = _BITS[variable.data_type]
        try:
            (value,) = real.unpack(bits.pack(int(text, 0)))
        except struct.error as error:
            raise ValueError(str(error)) from None
    if value is None:
        raise ValueError(text)
    return value


def _section(variable: ODVariable) -> str:
    is_entry = hasattr(variable.parent, "subindices")
    return f"{variable.index:04X}" + (f"sub{variable.subindex:X}" if is_entry else "")
