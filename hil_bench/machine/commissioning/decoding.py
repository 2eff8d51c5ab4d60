"""Says what a CANopen frame is, as far as its identifier and contents tell (CiA 301, CiA 305)."""

import struct
from typing import NamedTuple

from canopen.sdo.exceptions import SdoAbortedError

from hil_drivers import NmtState
from hil_drivers.emergency import Emergency

_NMT_COMMANDS = {
    1: "start",
    2: "stop",
    128: "enter pre-operational",
    129: "reset node",
    130: "reset communication",
}

_BROADCASTS = {
    0x000: "NMT",
    0x080: "SYNC",
    0x100: "TIME",
    0x7E4: "LSS answer",
    0x7E5: "LSS request",
}

_FUNCTIONS = {
    0x080: "EMCY",
    0x180: "TPDO1",
    0x200: "RPDO1",
    0x280: "TPDO2",
    0x300: "RPDO2",
    0x380: "TPDO3",
    0x400: "RPDO3",
    0x480: "TPDO4",
    0x500: "RPDO4",
    0x580: "SDO answer",
    0x600: "SDO request",
    0x700: "heartbeat",
}
"""The predefined connection set (CiA 301): an identifier less its node-ID."""

_OTHER = "other"


class Function(NamedTuple):
    """What an identifier is for.

    Attributes:
        name: as in ``TPDO1``.
        node_id: of the node that it belongs to; None for what concerns all.
    """

    name: str
    node_id: int | None


def function_of(can_id: int) -> Function:
    """Return what an 11-bit identifier is for in the predefined connection set.

    A device may be configured to send a PDO under any identifier; this tells the default.
    """
    if can_id in _BROADCASTS:
        return Function(_BROADCASTS[can_id], None)
    name, node_id = _FUNCTIONS.get(can_id & 0x780), can_id & 0x7F
    if name is None or node_id == 0:
        return Function(_OTHER, None)
    return Function(name, node_id)


def meaning_of(can_id: int, data: bytes) -> str:
    """Return what a frame says in words, empty where it holds values only."""
    name = function_of(can_id).name
    if name == "NMT" and len(data) == 2:
        target = f"node {data[1]}" if data[1] else "all nodes"
        return f"{_NMT_COMMANDS.get(data[0], f'command {data[0]}')}, {target}"
    if name == "heartbeat" and len(data) == 1:
        return _state(data[0] & 0x7F)
    if name == "EMCY" and len(data) == 8:
        code, register = struct.unpack_from("<HB", data)
        emergency = Emergency(code, register, data[3:], 0.0)
        what = "error reset" if emergency.is_reset else emergency.meaning
        return f"0x{code:04X}, {what}"
    if name.startswith("SDO") and len(data) == 8:
        return _sdo(name, data)
    return ""


def _state(number: int) -> str:
    if number == NmtState.INITIALISING:
        return "boot-up"
    return NmtState(number).name if number in frozenset(NmtState) else f"state {number}"


def _sdo(name: str, data: bytes) -> str:
    command, index, subindex = struct.unpack_from("<BHB", data)
    place = f"0x{index:04X}.{subindex:02X}"
    specifier = command >> 5
    if specifier == 4:
        code = int.from_bytes(data[4:], "little")
        return f"abort {place}, 0x{code:08X}, {SdoAbortedError.CODES.get(code, 'unknown code')}"
    if specifier == 2:
        return f"upload {place}"
    if name == "SDO request" and specifier == 1:
        return f"download {place}"
    if name == "SDO answer" and specifier == 3:
        return f"download {place} done"
    return "segment or block"
