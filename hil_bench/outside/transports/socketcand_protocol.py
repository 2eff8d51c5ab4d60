"""The raw mode of the socketcand protocol, as text: github.com/linux-can/socketcand.

    hub: < hi >              client: < open can0 >        hub: < ok >
                             client: < rawmode >          hub: < ok >
    client: < send 123 2 de ad >          hub, to the others: < frame 123 1700000000.123456 DEAD >

An identifier of eight digits is a 29-bit one. The protocol has no remote frames in this direction.
Frames of CAN FD are words of their own, with the flags of SocketCAN (`Frame.fd`):

    client: < fdsend 123 5 2 de ad >      hub: < fdframe 123 05 1700000000.123456 DEAD >
"""

import re
from typing import Final

from hil_bench.canopen_device.frame import FDF, Frame
from hil_bench.frame import FD_LENGTHS

DEFAULT_PORT = 29536
"""socketcand's own port."""

MAX_COMMAND: Final = 256
"""Longest command [byte]; a frame of 64 bytes takes 220."""


_EXTENDED_DIGITS: Final = 8
_FRAME: Final = re.compile(rb"< frame ([0-9A-F]{8}|[0-9A-F]{3}) \d+\.\d+ ((?:[0-9A-F]{2}){0,8}) ?")
_FD_FRAME: Final = re.compile(
    rb"< fdframe ([0-9A-F]{8}|[0-9A-F]{3}) 0([0-7]) \d+\.\d+ ((?:[0-9A-F]{2}){0,64}) ?"
)


def is_fd_frame(text: bytes) -> bool:
    """Return True if what a hub tells is a frame of CAN FD."""
    return text.startswith(b"< fdframe ")


def format_send(frame: Frame) -> bytes:
    """Return a client's command to send a frame; the protocol has no remote frames."""
    digits = b"%08X" if frame.is_extended else b"%03X"
    payload = frame.data.hex(" ").encode()
    if frame.fd:
        head = digits % frame.can_id, frame.fd, len(frame.data)
        return b"< fdsend %b %X %d %b >" % (*head, payload)
    return b"< send %b %d %b >" % (digits % frame.can_id, len(frame.data), payload)


def parse_frame(text: bytes) -> Frame | None:
    """Return the frame that a hub tells, given without its ">"; None where it is another word."""
    match, fd = _FRAME.fullmatch(text), 0
    if match is not None:
        can_id, payload = match.groups()
    elif (match := _FD_FRAME.fullmatch(text)) is not None and len(match[3]) // 2 in FD_LENGTHS:
        can_id, flags, payload = match.groups()
        fd = FDF | int(flags)
    else:
        return None
    data = bytes.fromhex(payload.decode())
    return Frame(int(can_id, 16), data, is_extended=len(can_id) == _EXTENDED_DIGITS, fd=fd)
