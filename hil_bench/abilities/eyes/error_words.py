"""Error frames in words, as SocketCAN lays them out (`linux/can/error.h`)."""

from typing import Final

from hil_bench.canopen_device.frame import Frame

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
