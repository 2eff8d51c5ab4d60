"""Says what a CANopen frame is, as far as the frame alone tells (CiA 301, CiA 305)."""

import struct
from typing import Final

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState
from hil_bench.canopen_device.words import emergency_text

# The words of CiA 301 and CiA 305 for the numbers in frames.

_NMT_COMMANDS: Final[dict[int, str]] = {
    NmtCommand.START: "start",
    NmtCommand.STOP: "stop",
    NmtCommand.ENTER_PRE_OPERATIONAL: "enter pre-operational",
    NmtCommand.RESET_NODE: "reset node",
    NmtCommand.RESET_COMMUNICATION: "reset communication",
}

_ABORTS: Final[dict[int, str]] = dict(
    code for name, code in vars(abort_codes).items() if name.isupper() and isinstance(code, tuple)
)

_LSS: Final = {
    0x04: "switch state global",
    0x11: "configure node-ID",
    0x13: "configure bit timing",
    0x15: "activate bit timing",
    0x17: "store configuration",
    0x40: "switch state selective, vendor-ID",
    0x41: "switch state selective, product code",
    0x42: "switch state selective, revision number",
    0x43: "switch state selective, serial number",
    0x44: "switched by its address",
    0x46: "identify slave, vendor-ID",
    0x47: "identify slave, product code",
    0x48: "identify slave, lowest revision number",
    0x49: "identify slave, highest revision number",
    0x4A: "identify slave, lowest serial number",
    0x4B: "identify slave, highest serial number",
    0x4C: "identify non-configured slave",
    0x4F: "slave identified",
    0x50: "non-configured slave identified",
    0x51: "fastscan",
    0x5A: "inquire vendor-ID",
    0x5B: "inquire product code",
    0x5C: "inquire revision number",
    0x5D: "inquire serial number",
    0x5E: "inquire node-ID",
}
"""LSS command specifiers (CiA 305)."""


def abort_text(code: int) -> str:
    """Return the meaning of an SDO abort code, in the words of CiA 301."""
    return _ABORTS.get(code, "unknown abort code")


def nmt_text(data: bytes) -> str:
    """Return the command of an NMT message; empty where the data are no NMT message."""
    if len(data) != 2:
        return ""
    target = f"node {data[1]}" if data[1] else "all nodes"
    return f"{_NMT_COMMANDS.get(data[0], f'command {data[0]}')}, {target}"


def state_text(number: int) -> str:
    """Return the name of an NMT state by its number in a heartbeat."""
    if number == NmtState.INITIALISING:
        return "boot-up"
    return NmtState(number).name if number in frozenset(NmtState) else f"state {number}"


def lss_text(data: bytes) -> str:
    """Return the service of an LSS message; empty where there are no data."""
    return _LSS.get(data[0], f"command {data[0]}") if data else ""


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


# Error frames in words, as SocketCAN lays them out (`linux/can/error.h`).

_LENGTH: Final = 8
_CONTROLLER, _PROTOCOL, _COUNTERS = 0x004, 0x008, 0x200

_CLASSES: Final = {
    0x001: "transmission timed out",
    0x002: "arbitration lost",
    0x010: "transceiver",
    0x020: "no acknowledge",
    0x040: "bus-off",
    0x100: "back from bus-off",
}
_STATES: Final = {
    0x01: "receive buffer overflow",
    0x02: "transmit buffer overflow",
    0x04: "receive warning level",
    0x08: "transmit warning level",
    0x10: "error-passive by reception",
    0x20: "error-passive by transmission",
    0x40: "error-active again",
}
_VIOLATIONS: Final = {
    0x01: "bit error",
    0x02: "form error",
    0x04: "stuff error",
    0x08: "a dominant bit not sent",
    0x10: "a recessive bit not sent",
    0x20: "overload",
}
_SENDING: Final = 0x80


def error_text(frame: Frame) -> str:
    """Return the text of an error frame, as "bit error while sending, TEC 8, REC 0"."""
    data = frame.data.ljust(_LENGTH, b"\0")
    parts = [text for bit, text in _CLASSES.items() if frame.can_id & bit]
    if frame.can_id & _CONTROLLER:
        parts += [text for bit, text in _STATES.items() if data[1] & bit]
    if frame.can_id & _PROTOCOL:
        found = [text for bit, text in _VIOLATIONS.items() if data[2] & bit]
        side = "while sending" if data[2] & _SENDING else "while receiving"
        parts.append(f"{' and '.join(found) or 'error'} {side}")
    if frame.can_id & _COUNTERS:
        parts.append(f"TEC {data[6]}, REC {data[7]}")
    return ", ".join(parts) or "error frame"
