"""The faults of a recording in its MF4 file: events with a begin and an end (EV blocks).

They are appended when the recording has ended, so a file whose writer was killed has none. Tools
such as asammdf show them as markers over time.
"""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from hil_bench.errors import about_file
from hil_bench.outside.recording import mdf_blocks as mdf
from hil_bench.outside.recording.spans import Span

_EV_DATA = struct.Struct("<BBBBB3sIHHqd")
"""Type, synchronisation, range, cause, flags, reserved, scopes, attachments, creator, time, its
factor."""

_MARKER, _BEGIN, _END, _OTHER = 6, 1, 2, 0
_LINKS = 5  # next, parent, the event where the range begins, name, comment
_FIRST = mdf.IDENTIFICATION_SIZE + mdf.HEADER.size + 8 * 4
"""Address of the HD block's link to the first event."""

_MOST_EVENTS = 10_000
_FARTHEST = 1 << 40  # an address that any file of ours has
_LONGEST_NAME = 1000
_NANOSECOND = 1e-9


def append_events(path: Path, spans: Sequence[Span]) -> None:
    """Append the faults of a recording to its file, which must be closed; `OSError` as it comes."""
    if not spans:
        return
    with path.open("r+b") as file:
        file.seek(0, 2)
        start = file.tell() + -file.tell() % 8
        blocks = _pack(spans, start)
        file.write(bytes(start - file.tell()) + blocks)
        file.flush()
        file.seek(_FIRST)  # linked in last: until then the file is as it was
        file.write(struct.pack("<Q", start + _name_size(spans)))


def read_events(path: Path) -> list[Span]:
    """Return the events of an MF4 file that have a begin and an end; damaged ones are left out.

    `ConfigError` where the file cannot be read.
    """
    with about_file(path, what="cannot be read", right="give a recording"), path.open("rb") as file:
        return list(_read(file))


def _pack(spans: Sequence[Span], start: int) -> bytes:
    """Return names and events as they stand from an address on: all names first."""
    names, address = [], start
    parts = []
    for span in spans:
        text = mdf.pack_text(span.label)
        names.append(address)
        parts.append(text)
        address += len(text)
    size = len(mdf.pack_block(b"##EV", (0,) * _LINKS, bytes(_EV_DATA.size)))
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
                _MARKER, mdf.TIME_SYNCHRONISED, kind, _OTHER, 0, b"", 0, 0, 0, ticks, _NANOSECOND
            )
            parts.append(mdf.pack_block(b"##EV", links, data))
        address = end + size
    return b"".join(parts)


def _name_size(spans: Sequence[Span]) -> int:
    return sum(len(mdf.pack_text(span.label)) for span in spans)


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
    size = mdf.HEADER.size + 8 * _LINKS + _EV_DATA.size
    if address > _FARTHEST:
        return None
    file.seek(address)
    block = file.read(size)
    if len(block) < size:
        return None
    kind, _, _, links = mdf.HEADER.unpack_from(block)
    if kind != b"##EV" or links < _LINKS or links > _MOST_EVENTS:
        return None
    following, _, begin, name, _ = struct.unpack_from(f"<{_LINKS}Q", block, mdf.HEADER.size)
    file.seek(address + mdf.HEADER.size + 8 * links)
    data = file.read(_EV_DATA.size)
    if len(data) < _EV_DATA.size:
        return None
    _, sync, span_kind, *_, ticks, factor = _EV_DATA.unpack(data)
    time = ticks * factor
    if sync != mdf.TIME_SYNCHRONISED or not abs(time) < 1e12:  # NaN, too
        return None
    return following, begin, _text(file, name), span_kind, time


def _text(file: BinaryIO, address: int) -> str:
    """Return the text of a block; empty where there is none."""
    file.seek(min(address, _FARTHEST))
    head = file.read(mdf.HEADER.size)
    if not address or len(head) < mdf.HEADER.size or not head.startswith(b"##TX"):
        return ""
    raw = file.read(_LONGEST_NAME).partition(b"\0")[0]
    text = raw.decode("utf-8", errors="replace")
    return "".join(each if each.isprintable() else "\ufffd" for each in text)
