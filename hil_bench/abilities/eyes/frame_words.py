"""Says what a CANopen frame is, as far as the frame alone tells (CiA 301, CiA 305)."""

import struct

from hil_bench.canopen_device.words import (
    abort_text,
    emergency_text,
    function_of,
    lss_text,
    nmt_text,
    state_text,
)

_MS_PER_DAY = 86_400_000


def meaning_of(can_id: int, data: bytes) -> str:
    """Return the meaning of a frame in words, empty where it holds values only."""
    name = function_of(can_id).name
    length = len(data)
    text = ""
    if name == "NMT":
        text = nmt_text(data)
    elif name == "heartbeat" and length == 1:
        text = state_text(data[0] & 0x7F)
    elif name == "EMCY" and length == 8:
        text = emcy_words(data)
    elif name == "SYNC" and length == 1:
        text = f"counter {data[0]}"
    elif name == "TIME" and length == 6:
        text = _time(data)
    elif name.startswith("SDO") and length == 8:
        text = _sdo(name, data)
    elif name.startswith("LSS"):
        text = lss_text(data)
    return text


def emcy_words(data: bytes) -> str:
    """Return code and meaning of an EMCY message, and what else is in it."""
    code, register = struct.unpack_from("<HB", data)
    rest = f", manufacturer {data[3:].hex(' ').upper()}" if any(data[3:]) else ""
    return f"0x{code:04X}, {emergency_text(code)}, error register 0x{register:02X}{rest}"


def _time(data: bytes) -> str:
    milliseconds, days = struct.unpack("<IH", data)
    seconds = (milliseconds & 0x0FFFFFFF) % _MS_PER_DAY / 1e3
    return f"day {days} since 1984-01-01, {seconds:.3f} s"


def _sdo(name: str, data: bytes) -> str:
    command, index, subindex = struct.unpack_from("<BHB", data)
    place = f"0x{index:04X}.{subindex:02X}"
    specifier = command >> 5
    if specifier == 4:
        code = int.from_bytes(data[4:], "little")
        return f"abort {place}, 0x{code:08X}, {abort_text(code)}"
    if specifier == 2:
        return f"upload {place}"
    if name == "SDO request" and specifier == 1:
        return f"download {place}"
    if name == "SDO answer" and specifier == 3:
        return f"download {place} done"
    return "segment or block"
