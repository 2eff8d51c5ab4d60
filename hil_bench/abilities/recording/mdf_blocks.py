"""Blocks of MDF 4 files, and the events in them."""

import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from hil_bench.errors import about_file
from hil_bench.outside.recording.channels import Span

# The blocks of a measurement data file, as far as recordings use them (ASAM MDF 4.1).
#
# Every block is: identifier, length, count of links, links (addresses in the file, 0 for none),
# data; all little-endian, at addresses that are multiples of 8. A recording has a data group for
# the signals, one for the data frames and one for the remote frames of the bus (ASAM MDF 4.1 bus
# logging, "CAN_DataFrame", "CAN_RemoteFrame"), and with the first error frame one for those
# ("CAN_ErrorFrame"), with the first frame of CAN FD one more "CAN_DataFrame". Each group's
# records stand in compressed, transposed blocks (DZ), chained by data lists (DL).

HEADER = struct.Struct("<4sIQQ")
"""Identifier, reserved, length with header and links, count of links."""

IDENTIFICATION = struct.Struct("<8s8s8s4sH30sHH")
"""File, version as text, program, reserved, version, reserved, what is unfinalised (twice)."""

IDENTIFICATION_SIZE = 64
"""Size of that block, and address of the HD block after it."""

VERSION = 410

HD_DATA = struct.Struct("<qhhBBBBdd")
"""Start time [ns since 1970], zone and summer time [min], flags, class, flags, angle, distance."""

FH_DATA = struct.Struct("<qhhB3s")
"""Time of the change [ns since 1970], zone and summer time [min], flags of time."""

DG_DATA = struct.Struct("<B7s")
"""Size of record identifiers."""

CG_DATA = struct.Struct("<QQHH4sII")
"""Record identifier, count of records, flags, path separator, reserved, size of a record, of its
invalidation bits."""

CN_DATA = struct.Struct("<BBBBIIIIBBH6d")
"""Type, synchronisation, data type, bit offset, byte offset, bits, flags, invalidation bit,
precision, reserved, attachments, ranges."""

SI_DATA = struct.Struct("<BBB5s")
"""Type of source, type of bus, flags."""

HL_DATA = struct.Struct("<HB5s")
"""Flags, type of compression."""

DL_DATA = struct.Struct("<B3sIQ")
"""Flags, reserved, count of blocks (here 1), offset of its first byte in the group's data."""

DZ_DATA = struct.Struct("<2sBBIQQ")
"""Identifier of the compressed block, type, reserved, record size, length before, length after."""

TRANSPOSED = 1
"""Type of compression: deflate after the records' bytes were transposed."""

MASTER, VALUE = 2, 0
"""Types of channel."""

TIME_SYNCHRONISED = 1

UNSIGNED, FLOAT, BYTES = 0, 4, 10
"""Data types of a channel, little-endian."""

BUS_EVENT, PLAIN_BUS_EVENT = 0x2, 0x4
"""Flags of a channel group."""

CHANNEL_BUS_EVENT = 1 << 10
"""Flag of a channel."""

SOURCE_BUS, BUS_CAN = 2, 2

DATA_FRAME, REMOTE_FRAME, ERROR_FRAME = "CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame"
"""Names of the bus groups' channels, as the standard gives them."""

SENT, RECEIVED = 1, 0
"""Values of their field Dir."""

_HEAD_FIELDS = [
    ("Timestamp", "<f8"),
    ("BusChannel", "u1"),
    ("ID", "<u4"),
    ("IDE", "u1"),
    ("DLC", "u1"),
    ("DataLength", "u1"),
    ("Dir", "u1"),
]

REMOTE_RECORD = np.dtype(_HEAD_FIELDS)
DATA_RECORD = np.dtype([*_HEAD_FIELDS, ("DataBytes", "V8")])
FD_RECORD = np.dtype(
    [*_HEAD_FIELDS, ("EDL", "u1"), ("BRS", "u1"), ("ESI", "u1"), ("DataBytes", "V64")]
)
ERROR_RECORD = np.dtype([*_HEAD_FIELDS, ("DataBytes", "V8"), ("ErrorType", "u1")])
"""ID and DataBytes are those of SocketCAN's error frames, as python-can writes and reads them here;
IDE is set, so that no tool takes the ID for one of the bus."""

OTHER_ERROR, BIT_ERROR, FORM_ERROR, STUFF_ERROR, ACK_ERROR = 0, 1, 2, 3, 5
"""Values of the field ErrorType; 4 is a wrong CRC."""


class Block(NamedTuple):
    """One block of a file.

    Attributes:
        kind: its identifier, as in ``b"##CN"``.
        links: addresses.
        data: what follows the links.
    """

    kind: bytes
    links: tuple[int, ...]
    data: bytes


def pack_block(kind: bytes, links: Sequence[int], data: bytes = b"") -> bytes:
    """Return a block's bytes, filled up to a multiple of 8."""
    length = HEADER.size + 8 * len(links) + len(data)
    block = b"".join(
        (
            HEADER.pack(kind, 0, length, len(links)),
            struct.pack(f"<{len(links)}Q", *links),
            data,
        )
    )
    return block + bytes(-len(block) % 8)


def pack_text(text: str, kind: bytes = b"##TX") -> bytes:
    """Return a text block, or with another kind an XML block."""
    raw = text.encode(errors="backslashreplace") + b"\0"
    return pack_block(kind, (), raw + bytes(-len(raw) % 8))


# The named times of a recording in its MF4 file, as faults: events of begin and end (EV blocks).
#
# They are appended when the recording has ended, and a property of the file says that they are
# complete. A file whose bench was killed has none, and says that they are not known.
# Tools such as asammdf show them as markers over time.

_EV_DATA = struct.Struct("<BBBBB3sIHHqd")
"""Type, synchronisation, range, cause, flags, reserved, scopes, attachments, creator, time, its
factor."""

_MARKER, _BEGIN, _END, _OTHER = 6, 1, 2, 0
_LINKS = 5  # next, parent, the event where the range begins, name, comment
_FIRST = IDENTIFICATION_SIZE + HEADER.size + 8 * 4
"""Address of the HD block's link to the first event."""
_COMMENT = _FIRST + 8
"""Address of its link to the comment."""
_HEADING = re.compile(rb"<TX>[^<]")
_PROPERTY = "faults"
_UNKNOWN, _COMPLETE = "unknown ", "complete"  # of one length, as one is written over the other
_SAID = re.compile(rf'<e name="{_PROPERTY}">(.{{{len(_UNKNOWN)}}})'.encode())

UNKNOWN_EVENTS = f'<common_properties><e name="{_PROPERTY}">{_UNKNOWN}</e></common_properties>'
"""Of a file's comment, behind its text: `append_events` was not yet there."""

_MOST_EVENTS = 10_000
_FARTHEST = 1 << 40  # an address that any file of ours has
_LONGEST_NAME = 1000
_LONGEST_COMMENT = 10_000
_NANOSECOND = 1e-9


def append_events(path: Path, spans: Sequence[Span]) -> None:
    """Append all named times of a recording to its closed file; `OSError` as it comes."""
    with path.open("r+b") as file:
        if spans:
            file.seek(0, 2)
            start = file.tell() + -file.tell() % 8
            blocks = _pack(spans, start)
            file.write(bytes(start - file.tell()) + blocks)
            file.flush()
            file.seek(_FIRST)  # linked in last: until then the file is as it was
            file.write(struct.pack("<Q", start + _name_size(spans)))
        begin, comment = _comment(file)
        if said := _SAID.search(comment):
            file.flush()
            file.seek(begin + said.start(1))
            file.write(_COMPLETE.encode())


def read_events(path: Path) -> list[Span]:
    """Return the events of an MF4 file that have a begin and an end; damaged ones are left out.

    `ConfigError` where the file cannot be read.
    """
    with about_file(path, what="cannot be read", right="give a recording"), path.open("rb") as file:
        return list(_read(file))


def holds_faults(path: Path) -> bool | None:
    """Return True if an MF4 file has all faults of its run; None for one that is of a bus.

    `ConfigError` where the file cannot be read.
    """
    with about_file(path, what="cannot be read", right="give a recording"), path.open("rb") as file:
        _, comment = _comment(file)
    if not _HEADING.search(comment):
        return None
    said = _SAID.search(comment)
    return said is not None and said[1] == _COMPLETE.encode()


def _comment(file: BinaryIO) -> tuple[int, bytes]:
    """Return the place of a file's comment, and its bytes, empty without one."""
    file.seek(_COMMENT)
    (address,) = struct.unpack("<Q", file.read(8).ljust(8, b"\0"))
    file.seek(min(address, _FARTHEST))
    return address, file.read(_LONGEST_COMMENT) if address else b""


def _pack(spans: Sequence[Span], start: int) -> bytes:
    """Return names and events as they stand from an address on: all names first."""
    names, address = [], start
    parts = []
    for span in spans:
        text = pack_text(span.label)
        names.append(address)
        parts.append(text)
        address += len(text)
    size = len(pack_block(b"##EV", (0,) * _LINKS, bytes(_EV_DATA.size)))
    last = address + 2 * size * (len(spans) - 1) + size
    for name, span in zip(names, spans, strict=True):
        begin, end = address, address + size
        following = end + size if end < last else 0
        for kind, time, links in (
            (_BEGIN, span.begin, (end, 0, 0, name, 0)),
            (_END, span.end, (following, 0, begin, name, 0)),
        ):
            ticks = round(time / _NANOSECOND)
            data = _EV_DATA.pack(
                _MARKER, TIME_SYNCHRONISED, kind, _OTHER, 0, b"", 0, 0, 0, ticks, _NANOSECOND
            )
            parts.append(pack_block(b"##EV", links, data))
        address = end + size
    return b"".join(parts)


def _name_size(spans: Sequence[Span]) -> int:
    return sum(len(pack_text(span.label)) for span in spans)


def _read(file: BinaryIO) -> Iterator[Span]:
    """Yield the ranges of a file; an address that leads nowhere ends it.

    Yields:
        Each range.
    """
    file.seek(_FIRST)
    (address,) = struct.unpack("<Q", file.read(8).ljust(8, b"\0"))
    begun: dict[int, tuple[float, str]] = {}
    for _ in range(_MOST_EVENTS):
        found = _event(file, address) if address else None
        if found is None:
            return
        following, begin, name, kind, time = found
        if kind == _BEGIN:
            begun[address] = time, name
        elif kind == _END and begin in begun:
            start, name = begun.pop(begin)
            if start <= time:
                yield Span(start, time, name)
        address = following


def _event(file: BinaryIO, address: int) -> tuple[int, int, str, int, float] | None:
    """Return next event, begin of its range, name, kind of range and time [s]; None for none."""
    size = HEADER.size + 8 * _LINKS + _EV_DATA.size
    if address > _FARTHEST:
        return None
    file.seek(address)
    block = file.read(size)
    if len(block) < size:
        return None
    kind, _, _, links = HEADER.unpack_from(block)
    if kind != b"##EV" or links < _LINKS or links > _MOST_EVENTS:
        return None
    following, _, begin, name, _ = struct.unpack_from(f"<{_LINKS}Q", block, HEADER.size)
    file.seek(address + HEADER.size + 8 * links)
    data = file.read(_EV_DATA.size)
    if len(data) < _EV_DATA.size:
        return None
    _, sync, span_kind, *_, ticks, factor = _EV_DATA.unpack(data)
    time = ticks * factor
    if sync != TIME_SYNCHRONISED or not abs(time) < 1e12:  # NaN, too
        return None
    return following, begin, _text(file, name), span_kind, time


def _text(file: BinaryIO, address: int) -> str:
    """Return the text of a block; empty where there is none."""
    file.seek(min(address, _FARTHEST))
    head = file.read(HEADER.size)
    if not address or len(head) < HEADER.size or not head.startswith(b"##TX"):
        return ""
    raw = file.read(_LONGEST_NAME).partition(b"\0")[0]
    text = raw.decode("utf-8", errors="replace")
    return "".join(each if each.isprintable() else "\ufffd" for each in text)
