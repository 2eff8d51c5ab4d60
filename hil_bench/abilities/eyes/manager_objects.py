"""Objects of a master and configuration manager in words (CiA 302-2 and 302-3).

Bits and values as `hil_drivers.boot` writes them and as Lely's master reads them.
"""

import struct
from collections.abc import Callable
from typing import Final

from hil_bench.canopen_device.datatypes import DOMAIN, UNSIGNED8, UNSIGNED32, DataType

CONCISE_DCF: Final = 0x1F22
REQUEST_NMT: Final = 0x1F82

OBJECTS: Final[dict[int, tuple[str, DataType]]] = {
    0x1F80: ("NMT startup", UNSIGNED32),
    0x1F89: ("Boot time", UNSIGNED32),
}
ARRAYS: Final[dict[int, tuple[str, DataType]]] = {
    0x1F20: ("Store DCF", DOMAIN),
    CONCISE_DCF: ("Concise DCF", DOMAIN),
    0x1F25: ("Configuration request", UNSIGNED32),
    0x1F26: ("Expected configuration date", UNSIGNED32),
    0x1F27: ("Expected configuration time", UNSIGNED32),
    0x1F81: ("NMT slave assignment", UNSIGNED32),
    REQUEST_NMT: ("Request NMT", UNSIGNED8),
    0x1F83: ("Request guarding", UNSIGNED8),
    0x1F84: ("Expected device type", UNSIGNED32),
    0x1F85: ("Expected vendor-ID", UNSIGNED32),
    0x1F86: ("Expected product code", UNSIGNED32),
    0x1F87: ("Expected revision number", UNSIGNED32),
    0x1F88: ("Expected serial number", UNSIGNED32),
}
"""Name and type of the entries; each has the node-ID of a slave as its sub-index."""

_STARTUP: Final = {
    1 << 0: "is the NMT master",
    1 << 1: "starts all at once",
    1 << 2: "does not start by itself",
    1 << 3: "does not start slaves",
    1 << 4: "resets all if a mandatory slave is lost",
    1 << 5: "flying master",
    1 << 6: "stops all if a mandatory slave is lost",
}
_SLAVE: Final = {
    1 << 0: "in the network",
    1 << 2: "booted",
    1 << 3: "mandatory",
    1 << 4: "not reset while OPERATIONAL",
}
_STATES: Final = {
    4: "stop",
    5: "start",
    6: "reset node",
    7: "reset communication",
    0x7F: "enter pre-operational",
}
_CONFIGURE: Final = int.from_bytes(b"conf", "little")
_HEAD: Final = struct.Struct("<HBI")
_SHOWN: Final = 3
_NUMBER: Final = 4


def object_of(index: int, subindex: int) -> tuple[str, DataType] | None:
    """Return name and data type of a manager's object; None for another one."""
    if index in ARRAYS:
        name, data_type = ARRAYS[index]
        return name, data_type if subindex else UNSIGNED8
    return OBJECTS.get(index) if subindex == 0 else None


def manager_text(index: int, subindex: int, value: int) -> str:
    """Return the value of a manager's object in words; empty for one that is a plain number."""
    words = _WORDS.get(index)
    is_entry = bool(subindex) is (index in ARRAYS)
    return words(value) if words is not None and is_entry else ""


def dcf_text(raw: bytes) -> str:
    """Return a concise DCF in words: how many entries, and the first ones."""
    entries, problem = _entries(raw)
    shown = [f"0x{index:04X}.{sub:02X} := {_value(data)}" for index, sub, data in entries[:_SHOWN]]
    more = len(entries) - _SHOWN
    words = ", ".join(shown) + (f", and {more} more" if more > 0 else "")
    count = f"{len(entries)} {'entry' if len(entries) == 1 else 'entries'}"
    return f"{count}{': ' if words else ''}{words}" + (" ..." if problem else "")


def dcf_problem(raw: bytes) -> str:
    """Return the fault of a concise DCF's bytes; empty where there is none."""
    return _entries(raw)[1]


def _entries(raw: bytes) -> tuple[list[tuple[int, int, bytes]], str]:
    """Return the entries that are whole, and the fault of what follows them."""
    if len(raw) < _NUMBER:
        return [], "is no concise DCF, which begins with 4 bytes"
    count, place = int.from_bytes(raw[:_NUMBER], "little"), _NUMBER
    entries: list[tuple[int, int, bytes]] = []
    while len(entries) < count:
        end = place + _HEAD.size
        index, subindex, length = _HEAD.unpack_from(raw, place) if end <= len(raw) else (0, 0, 0)
        if end + length > len(raw):
            return entries, f"ends within entry {len(entries) + 1} of {count}"
        entries.append((index, subindex, raw[end : end + length]))
        place = end + length
    rest = len(raw) - place
    return (
        entries,
        f"{rest} byte{'s' * (rest > 1)} too many behind its {count} entries" if rest else "",
    )


def _value(data: bytes) -> str:
    if len(data) <= _NUMBER:
        return f"0x{int.from_bytes(data, 'little'):0{2 * len(data)}X}" if data else "nothing"
    return f"{len(data)} bytes"


def _startup(value: int) -> str:
    return _bits(value, _STARTUP, "" if value & 4 else "starts by itself")


def _slave(value: int) -> str:
    retries, guard_ms = value >> 8 & 0xFF, value >> 16
    guarded = f"guarded every {guard_ms} ms, {retries} times" if guard_ms else ""
    return _bits(value, _SLAVE, guarded)


def _bits(value: int, words: dict[int, str], more: str) -> str:
    said = [text for bit, text in words.items() if value & bit]
    return ", ".join([f"0x{value:08X}", *said, *([more] if more else [])])


_WORDS: Final[dict[int, Callable[[int], str]]] = {
    0x1F25: lambda value: '"conf"' if value == _CONFIGURE else "",
    0x1F26: lambda value: f"{value} days since 1984-01-01",
    0x1F27: lambda value: f"{value} ms after midnight",
    0x1F80: _startup,
    0x1F81: _slave,
    REQUEST_NMT: lambda value: _STATES.get(value, ""),
    0x1F89: lambda value: f"{value} ms",
}
