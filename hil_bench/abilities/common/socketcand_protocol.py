"""The raw mode of the socketcand protocol, as text: github.com/linux-can/socketcand.

    hub: < hi >              client: < open can0 >        hub: < ok >
                             client: < rawmode >          hub: < ok >
    client: < send 123 2 de ad >          hub, to the others: < frame 123 1700000000.123456 DEAD >

An identifier of eight digits is a 29-bit one. The protocol has no remote frames in this direction.
Frames of CAN FD are words of their own, with the flags of SocketCAN (`Frame.fd`):

    client: < fdsend 123 5 2 de ad >      hub: < fdframe 123 05 1700000000.123456 DEAD >
"""

import functools
import re
from binascii import hexlify
from typing import Final

from hil_bench.canopen_device.frame import FDF, Frame, make_frame
from hil_bench.frame import FD_LENGTHS

# A client's side.

MAX_COMMAND: Final = 256
"""Longest command [byte]; a frame of 64 bytes takes 220."""


_EXTENDED_DIGITS: Final = 8
_FRAME: Final = re.compile(rb"< frame ([0-9A-F]{8}|[0-9A-F]{3}) \d+\.\d+ ((?:[0-9A-F]{2}){0,8}) ?")
_FD_FRAME: Final = re.compile(
    rb"< fdframe ([0-9A-F]{8}|[0-9A-F]{3}) 0([0-7]) \d+\.\d+ ((?:[0-9A-F]{2}){0,64}) ?"
)


def is_fd_frame(text: bytes) -> bool:
    """Return True if what a hub sends is a frame of CAN FD."""
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
    """Return the frame that a hub sends, given without its ">"; None where it is another word."""
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


# The hub's side, and a limit on a program's frames.

MOST_BAD: Final = 16
"""Malformed commands in a row, in the raw mode, after which a client is cut off."""

JOIN_DELAY = 0.05
"""How long frames are held back from a client that has just entered the raw mode and has not said
anything yet [s]: python-can compares what it reads after "rawmode" with "< ok >" exactly."""

CLASSICAL: Final = b"this bus is classical CAN; fd = true in [bus] of bench.toml makes it CAN FD"
"""Answer to a frame of CAN FD on another bus."""

_NS_PER_S: Final = 1_000_000_000
_CHANNEL: Final = re.compile(r"[A-Za-z0-9_.-]{1,15}")

_SEND: Final = re.compile(
    rb"< send ([01][0-9A-Fa-f]{7}|[0-7][0-9A-Fa-f]{2}|[0-9A-Fa-f]{1,2}) +([0-8])"
    rb"((?: +[0-9A-Fa-f]{1,2}){0,8}) *"
)

_FD_SEND: Final = re.compile(
    rb"< fdsend ([01][0-9A-Fa-f]{7}|[0-7][0-9A-Fa-f]{2}|[0-9A-Fa-f]{1,2}) +0?([0-7]) +(\d\d?)"
    rb"((?: +[0-9A-Fa-f]{1,2}){0,64}) *"
)


def check_channel(name: str) -> None:
    """Refuse a channel that has no name that SocketCAN would take.

    Raises:
        ValueError: the name is not made of 1 to 15 plain characters.
    """
    if not _CHANNEL.fullmatch(name):
        raise ValueError(f"channel {name!r}: 1 to 15 letters, digits, '_', '.' or '-' are right")


@functools.lru_cache(maxsize=256)  # SYNC, heartbeats, commands that stay
def parse_send(command: bytes) -> Frame | None:
    """Return the frame of a "send" or "fdsend" command, given without its ">".

    Returns:
        The frame, or None where the command is malformed, or has a length that no DLC has.
    """
    match, fd = _SEND.fullmatch(command), 0
    if match is not None:
        can_id, length, text = match.groups()
    elif (match := _FD_SEND.fullmatch(command)) is not None and int(match[3]) in FD_LENGTHS:
        can_id, flags, length, text = match.groups()
        fd = FDF | int(flags)
    else:
        return None
    try:
        data = bytes.fromhex(text.decode())
    except ValueError:  # a byte of one digit
        data = bytes([int(byte, 16) for byte in text.split()])
    if len(data) != int(length):
        return None
    is_extended = len(can_id) == _EXTENDED_DIGITS
    return make_frame(Frame, (int(can_id, 16), data, False, is_extended, 0, fd))


def is_fd_command(command: bytes) -> bool:
    """Return True if a command is one of CAN FD."""
    return command.startswith(b"< fdsend ")


def is_remote_request(command: bytes) -> bool:
    """Return True if a "send" command is how python-can writes a remote frame: without its bytes.

    The protocol has no remote frames. One of length 0 looks like a data frame.
    """
    match = _SEND.fullmatch(command)
    return match is not None and not match[3].split()


def stamp_of(now: int) -> bytes:
    """Return a time [ns] as a hub writes it."""
    seconds, nanoseconds = divmod(now, _NS_PER_S)
    return b"%d.%06d" % (seconds, nanoseconds // 1_000)


def format_frame(frame: Frame, stamp: bytes) -> bytes:
    """Return a hub's message of a frame to its clients, with the stamp of a time."""
    can_id, data, _, is_extended, _, fd = frame
    if fd:
        text = b"< fdframe %08X %02X %b %b >" if is_extended else b"< fdframe %03X %02X %b %b >"
        return text % (can_id, fd, stamp, data.hex().upper().encode())
    return _head(can_id, is_extended) + stamp + b" " + hexlify(data).upper() + b" >"


@functools.lru_cache(maxsize=4096)
def _head(can_id: int, is_extended: bool) -> bytes:
    return (b"< frame %08X " if is_extended else b"< frame %03X ") % can_id


BURST: Final = 10_000_000
"""Time on the bus of the frames that a program may send at once after it was quiet [ns]."""


class RateLimit:
    """A limit on a program's frames: as many as a bus of some bit rate carries.

    It is the account of one program, by the time that is passed in.

    Args:
        bitrate: of the bus [bit/s].
    """

    def __init__(self, bitrate: float) -> None:
        self._time_of_bit = _NS_PER_S / bitrate
        self._free_at = 0.0

    def delay(self, now: int) -> float:
        """Return the time until the next frame may be sent [ns], 0 for at once.

        Args:
            now: the time, on any clock that never steps back [ns].
        """
        return max(0.0, self._free_at - BURST - now)

    def take(self, bits: float, now: int) -> None:
        """Account for a frame of so many bits that is sent now [ns]."""
        self._free_at = max(self._free_at, now) + bits * self._time_of_bit
