"""States and errors of CANopen in words."""

from collections.abc import Mapping
from typing import Any, Final

_CAN_COUNTS = {
    "failed": "repeated",
    "lost": "lost in a full buffer",
    "missed": "not read",
}
"""The counts of a CAN controller, in words."""

_EMERGENCIES: Final = {
    0x8110: "CAN overrun, objects lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat error",
    0x8140: "recovered from bus off",
    0x8150: "CAN-ID collision",
    0x8210: "PDO not processed due to length error",
    0x8220: "PDO length exceeded",
    0x8230: "DAM MPDO not processed, destination object not available",
    0x8240: "unexpected SYNC data length",
    0x8250: "RPDO time-out",
}
_EMERGENCY_CLASSES: Final = {
    0x10: "generic error",
    0x20: "current",
    0x21: "current, CANopen device input side",
    0x22: "current inside the CANopen device",
    0x23: "current, CANopen device output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the CANopen device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "CANopen device temperature",
    0x50: "CANopen device hardware",
    0x60: "CANopen device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "CANopen device specific",
}
"""Emergency error codes of CiA 301: one by one, and by their high byte."""


NO_MEANING: Final = "code without a meaning in CiA 301"
"""The text of an emergency error code that CiA 301 does not have."""


def is_error_reset(code: int) -> bool:
    """Return True if an emergency error code reports an error as gone: 0x0000 to 0x00FF."""
    return code < 0x0100


def emergency_text(code: int) -> str:
    """Return the meaning of an emergency error code, in the words of CiA 301."""
    if is_error_reset(code):
        return "error reset"
    high = code >> 8
    text = _EMERGENCIES.get(code) or _EMERGENCY_CLASSES.get(high)
    return text or _EMERGENCY_CLASSES.get(high & 0xF0) or NO_MEANING


def can_text(can: Mapping[str, Any]) -> str:
    """Return the state of a node's CAN controller on a bus of copper, without zero counts."""
    counts = "".join(f", {can[key]} {word}" for key, word in _CAN_COUNTS.items() if can[key])
    return f"{can['state']} TEC {can['tec']} REC {can['rec']}{counts}"
